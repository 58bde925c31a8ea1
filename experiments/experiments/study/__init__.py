"""The paper's comparison as distributions: paired drives in process, ablations, limits, claims."""
