"""A small valid scenario, and ways to spoil it."""

import copy

import pytest
import yaml

from scenario_publisher import scenario

VALID = """
schema: 1
name: bend
description: A left-hand bend.
road:
  centre_line:
    start: {x_m: 0.0, y_m: 0.0, yaw_rad: 0.0}
    segments:
      - straight: {length_m: 40.0}
      - arc: {length_m: 40.0, curvature_1pm: 0.02}
  edges:
    left: {offset_m: 4.0}
    right: {offset_m: -4.0}
path:
  start: {x_m: 0.0, y_m: 0.0, yaw_rad: 0.0}
  segments:
    - straight: {length_m: 40.0}
    - arc: {length_m: 40.0, curvature_1pm: 0.02}
speed: {constant_mps: 10.0}
friction: 1.0
start: {progress_m: 0.0}
stop: {progress_m: 60.0, time_s: 20.0}
obstacles:
  - {x_m: 20.0, y_m: 2.0, radius_m: 0.5}
  - {station_m: 60.0, offset_m: -2.0, radius_m: 0.5}
"""


@pytest.fixture
def tree():
    """The scenario as nested dicts and lists, to be changed at will."""
    return copy.deepcopy(yaml.safe_load(VALID))


@pytest.fixture
def text():
    """The scenario as text."""
    return VALID


@pytest.fixture
def make():
    """Parse a tree or a text under the file name `bend.yaml`."""

    def parse(given):
        written = given if isinstance(given, str) else yaml.safe_dump(given, sort_keys=False)
        return scenario.parse(written, 'bend.yaml')

    return parse
