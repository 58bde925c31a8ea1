"""Runs: which nodes, started, watched, stopped, and noted."""
