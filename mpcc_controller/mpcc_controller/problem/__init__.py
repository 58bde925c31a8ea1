"""The optimal control problems, stage by stage: costs, constraints, numbers per stage."""
