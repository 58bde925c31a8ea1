"""The car has no favourite side: mirrored steering mirrors the motion, in every manoeuvre."""

import numpy as np
import pytest

from node_runtime import named_vector
from vehicle_plant import parameters
from vehicle_plant.manoeuvre import MANOEUVRES
from vehicle_plant.manoeuvres import procedure, settings
from vehicle_plant.state import Outputs, State

COLUMNS = (*named_vector.names(State), *named_vector.names(Outputs))
SIDES = {'fl': 'fr', 'fr': 'fl', 'rl': 'rr', 'rr': 'rl'}
ODD = {'Y', 'psi', 'vy', 'r', 'phi', 'p', 'tan_alpha', 'ay', 'Fy'}  # change sign in a mirror
LARGE = {'Fz', 'Fx', 'Fy', 'torque', 'front', 'rear'}  # N, N m: thousands


def mirrored(name):
    """Return the name and the sign under which a column appears in the mirror."""
    parts = name.split('.')
    odd = parts[-1] in ODD or parts[1] == 'steer'
    return '.'.join(SIDES.get(part, part) for part in parts), -1 if odd else 1


def test_a_mirror_shown_in_a_mirror_is_the_car():
    for name in COLUMNS:
        other, sign = mirrored(name)
        assert other in COLUMNS
        assert mirrored(other) == (name, sign)


def to_the_right(run):
    """Return the run with mirrored steering."""

    def law(t, vx):
        target = run.law(t, vx)
        return target._replace(delta=-target.delta)

    return run._replace(law=law)


@pytest.mark.parametrize('name', MANOEUVRES)
def test_mirrored_steering_mirrors_every_column(name):
    case = procedure.Case(parameters.load(), 1.0, settings.load())
    for run in MANOEUVRES[name].runs(case):
        left, right = (procedure.drive(side, case) for side in (run, to_the_right(run)))
        for column in COLUMNS:
            other, sign = mirrored(column)
            scale = 1e4 if LARGE & set(column.split('.')) else 1.0
            difference = np.abs(left.column(column) - sign * right.column(other)).max()
            assert difference <= 1e-9 * scale, (run.label, column)
