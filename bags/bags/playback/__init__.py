"""Recorded messages sent again, at the pace at which they were recorded."""
