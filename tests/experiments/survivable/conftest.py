"""Emergencies on a straight road, as files."""

import pytest
import yaml
from closed_loops import fixed_weights

from experiments import simulation
from scenario_publisher import scenario


@pytest.fixture(scope='session')
def straight_emergency():
    """Return setup(speed, obstacles, ...) -> Setup: two lanes of a straight road, from x = 0."""

    def setup(speed, obstacles, friction=1.0, controller='mpcc', left=6.0, right=-2.5):
        line = {'start': {'x_m': -20.0, 'y_m': 0.0, 'yaw_rad': 0.0}}
        document = {
            'schema': 1,
            'name': 'emergency',
            'description': 'of a test',
            'road': {
                'centre_line': line | {'segments': [{'straight': {'length_m': 300.0}}]},
                'edges': {'left': {'offset_m': left}, 'right': {'offset_m': right}},
            },
            'path': {
                'start': {'x_m': 0.0, 'y_m': 0.0, 'yaw_rad': 0.0},
                'segments': [{'straight': {'length_m': 220.0}}],
            },
            'speed': {'constant_mps': speed},
            'friction': friction,
            'start': {'progress_m': 0.0},
            'stop': {'progress_m': 140.0, 'time_s': 15.0},
            'obstacles': obstacles,
        }
        scn = scenario.parse(yaml.safe_dump(document), 'emergency.yaml')
        return simulation.prepare_scenario(
            scn, controller, {'controller': fixed_weights(controller)}
        )

    return setup
