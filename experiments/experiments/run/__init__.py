"""Runs of the node graph: processes started, watched, stopped, recorded and compared."""
