"""Ranges of quantities that more than one package takes: what a scenario allows, nodes accept."""

from node_runtime.parameters import Range

ROAD_FRICTION = Range(0.05, 1.5, '-')  # scale of the grip of the road, 1 is dry asphalt
# of a run, until it fails; places in topics.yaml are as wide as a car drives in the longest one
RUN_TIME = Range(0.5, 600.0, 's')
SPEED = Range(1.0, 100.0, 'm/s')  # of a start, desired along a path
