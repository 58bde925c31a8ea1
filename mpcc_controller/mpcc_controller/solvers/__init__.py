"""Solvers of stage-wise problems; none of them knows a vehicle."""
