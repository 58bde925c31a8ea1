"""The first study over settings: what was published of it, from the rows that are kept.

plan            what was fixed beforehand: paper/settings/settings_study.yaml
preconditions   which settings say something about the paper's claims
primaries       the claims on a setting
outcomes        preconditions and claims of every setting, from the rows of drives
recompute       every published share
"""
