"""The linear program finds what closed forms of a point mass give."""

import numpy as np
import pytest

from experiments.families import demand
from experiments.families.demand import Area, Corridor

SPEED = 20.0
WIDE = 1e3
AREA = Area(60.0, 0.5, 2.0, on_left=True)


def road(length, low=-WIDE, areas=()):
    x = np.arange(0.0, length + demand.STEP_M / 2, demand.STEP_M)
    return Corridor(x, np.full(len(x), low), np.full(len(x), WIDE), tuple(areas))


@pytest.mark.parametrize('offset', [0.5, 2.0])
@pytest.mark.parametrize('length', [30.0, 60.0])
def test_an_offset_with_any_heading_at_its_end_takes_a_constant_acceleration(length, offset):
    """y = a (L / v)^2 / 2."""
    corridor = road(length)
    corridor.low[-1] = offset
    peak = demand.least_peak(corridor, SPEED)
    assert peak == pytest.approx(2.0 * offset * (SPEED / length) ** 2, rel=1e-6)


def test_an_offset_that_must_be_kept_takes_twice_as_much():
    """Accelerate half of the way, brake the lateral motion half of the way: y = a (L / v)^2 / 4."""
    offset, length = 2.0, 40.0
    corridor = road(2 * length)
    corridor.low[corridor.x >= length] = offset
    corridor.high[:] = offset
    peak = demand.least_peak(corridor, SPEED)
    # the end is required at grid points only, so the mass may use a part of the next step
    longest = length + demand.STEP_M
    assert 4.0 * offset * (SPEED / longest) ** 2 < peak <= 4.0 * offset * (SPEED / length) ** 2


def test_the_acceleration_grows_with_the_square_of_the_speed():
    slow, fast = (demand.least_peak(road(80.0, areas=[AREA]), v) for v in (10.0, 30.0))
    assert fast == pytest.approx(9.0 * slow, rel=1e-6)


def test_passing_on_the_other_side_is_the_mirror_image():
    mirrored = AREA._replace(y=-AREA.y, on_left=False)
    left, right = (demand.least_peak(road(80.0, areas=[area]), SPEED) for area in (AREA, mirrored))
    assert left == pytest.approx(right)


def test_a_closed_road_cannot_be_passed():
    assert demand.least_peak(road(20.0, low=1.0), SPEED) == float('inf')
