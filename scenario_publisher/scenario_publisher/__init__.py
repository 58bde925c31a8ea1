"""Scenarios: road, coarse path, obstacles; the node that publishes them."""
