"""The multi-body model of CommonRoad as the plant of the node graph."""

import json
import subprocess
import sys

import numpy as np
import pytest

from bags.storage import read
from experiments import simulation
from vehicle_plant import parameters

pytest.importorskip('vehiclemodels')
pytestmark = pytest.mark.usefixtures('dds')
SECONDS = 240  # of wall time
SETTINGS = {
    'plant': {'plant_params': parameters.MULTI_BODY_CAR},
    'controller': {'car_file': 'car_commonroad_320i.yaml'},
}


def test_over_ros_and_in_process_the_bits_are_the_same(tmp_path):
    command = [sys.executable, '-m', 'experiments.cli', 'run', 'double_lane_change']
    command += ['--controller', 'mpcc', '--out', str(tmp_path)]
    for role, values in SETTINGS.items():
        for name, value in values.items():
            command += ['--set', f'{role}.{name}={value}']
    result = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS)
    assert result.returncode == 0, result.stdout + result.stderr
    bag = read.load(tmp_path / 'double_lane_change/mpcc')
    noted = json.loads(bag.run_info['parameters'])['plant']
    assert noted['model'] == parameters.MULTI_BODY
    recorded = read.columns(bag)
    computed = simulation.run(simulation.prepare('double_lane_change', 'mpcc', SETTINGS))
    for topic in ('/vehicle/odometry', '/vehicle/wheels', '/vehicle/imu', '/controller/command'):
        for name, column in computed[topic].items():
            assert np.array_equal(column, getattr(recorded[topic], name)), f'{topic}: {name}'
