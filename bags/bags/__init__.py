"""Runs recorded to MCAP, replayed, and compared offline."""
