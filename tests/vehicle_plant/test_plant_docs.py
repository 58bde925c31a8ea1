"""docs/plant.md says what is so, and its commands run."""

import re
import shlex
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from node_runtime import named_vector
from vehicle_plant import identify, integrator, parameters, road_friction
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import Simulator
from vehicle_plant.state import State

TEXT = (Path(__file__).parents[2] / 'docs' / 'plant.md').read_text()
COMMANDS = re.findall(r'^identify .*?(?=\s*#|$)', TEXT, flags=re.MULTILINE)


def test_states_add_up():
    numbers = re.findall(r'^\|.*\| (\d+)( per wheel)? \|', TEXT, flags=re.MULTILINE)
    total = sum(int(n) * (4 if each else 1) for n, each in numbers)
    assert total == len(named_vector.names(State)) == 42
    assert f'{total} states' in TEXT


def test_there_are_three_commands():
    assert len(COMMANDS) == 3


@pytest.mark.parametrize('command', COMMANDS)
def test_identify_runs_as_written(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    _, *arguments = shlex.split(command)
    assert identify.main(arguments) == 0
    assert Path(arguments[1]).is_file()
    assert Path(arguments[1]).with_suffix('.png').is_file()


def test_named_files_exist():
    for name in re.findall(r'`(\w+\.yaml)`', TEXT):
        assert parameters.config_file(name).is_file()


def test_example_of_patches_is_a_map():
    corners = [float(n) for n in re.search(r'corners_m:=\[(.*?)\]', TEXT)[1].split(',')]
    friction = [float(n) for n in re.search(r'patches.friction:=\[(.*?)\]', TEXT)[1].split(',')]
    patches = road_friction.pad_patches(road_friction.patch_array(corners, friction))
    assert float(road_friction.friction_at(50.0, 1.0, 1.0, patches)) == 0.3
    assert float(road_friction.friction_at(50.0, -1.0, 1.0, patches)) == 1.0


def test_fastest_mode_is_the_one_that_is_named(params):
    fastest = float(re.search(r'carcass, (\d+) 1/s', TEXT)[1])
    derivative, _ = integrator.plant_functions()
    x, u, p = (ca.SX.sym(n, derivative.size1_in(i)) for i, n in enumerate('xup'))
    slope = ca.Function('A', [x, u, p], [ca.jacobian(derivative(x, u, p)[0], x)])
    numbers = integrator.parameter_vector(params, 1.0)
    for speed in (0.5, 5.0, 50.0):
        car = Simulator(params, 1.0, Start(0.0, 0.0, 0.0, speed))
        row = car.advance(None, 100).rows[-1, : x.size1()]
        modes = np.abs(np.linalg.eigvals(np.array(slope(row, np.zeros(3), numbers))))
        assert modes.max() == pytest.approx(fastest, rel=0.02)
