"""A run with a tyre property file (.tir) of one's own, with real nodes over Fast DDS."""

import json
import subprocess
import sys

import pytest
from tyre_files import property_file

from bags.storage import read
from node_runtime import parameters as yaml_parameters
from vehicle_plant import parameters

pytestmark = pytest.mark.usefixtures('dds')
TYRE = 'tyre_205_60r15.yaml'
SECONDS = 240  # of wall time


def test_bags_run_drives_with_a_property_file_and_notes_its_coefficients(tmp_path):
    (tmp_path / 'my.tir').write_text(property_file(TYRE))
    command = [sys.executable, '-m', 'experiments.cli', 'run', 'straight', '--out', 'runs']
    for setting in ('tyre_set=./my.tir', 'stop.x_m=15.0', 'stop.armed_after_m=1.0'):
        command += ['--set', f'plant.{setting}']
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=SECONDS)
    assert result.returncode == 0, result.stdout + result.stderr
    bag = read.load(tmp_path / 'runs/straight/mpcc')
    noted = json.loads(bag.run_info['parameters'])['plant']
    assert noted['tyre_set'] == './my.tir'
    for name, value in yaml_parameters.flatten(parameters.load_tyre(TYRE)).items():
        assert noted[name] == value, name
    assert len(bag.recordings['/vehicle/odometry'].payloads) > 100
