"""The linear program finds what closed forms of a point mass give."""

import numpy as np
import pytest

from experiments.families import lane_change_task as demand
from experiments.families.lane_change_task import Area

WIDE = 1e3
AREA = Area(60.0, 0.5, 2.0, on_left=True)


def road(length, low=-WIDE):
    """Return x and the bounds of y of a straight road."""
    x = np.arange(0.0, length + demand.STEP_M / 2, demand.STEP_M)
    return x, np.full(len(x), low), np.full(len(x), WIDE)


@pytest.mark.parametrize('offset', [0.5, 2.0])
@pytest.mark.parametrize('length', [30.0, 60.0])
def test_an_offset_with_any_heading_at_its_end_takes_a_constant_curvature(length, offset):
    """y = k L^2 / 2."""
    x, low, high = road(length)
    low[-1] = offset
    peak = demand.least_curvature(x, low, high, ())
    assert peak == pytest.approx(2.0 * offset / length**2, rel=1e-6)


def test_an_offset_that_must_be_kept_takes_twice_as_much():
    """To one side half of the way, to the other half of the way: y = k L^2 / 4."""
    offset, length = 2.0, 40.0
    x, low, high = road(2 * length)
    low[x >= length] = offset
    high[:] = offset
    peak = demand.least_curvature(x, low, high, ())
    # the end is required at grid points only, so the mass may use a part of the next step
    longest = length + demand.STEP_M
    assert 4.0 * offset / longest**2 < peak <= 4.0 * offset / length**2


def test_an_area_is_passed_on_its_side_and_the_other_side_is_the_mirror_image():
    mirrored = AREA._replace(y=-AREA.y, on_left=False)
    left, right = (demand.least_curvature(*road(80.0), [area]) for area in (AREA, mirrored))
    assert left == pytest.approx(right)
    # the way to its edge abreast of its middle takes the most
    assert left == pytest.approx(2.0 * (AREA.y + AREA.radius) / AREA.x**2, rel=1e-6)


def test_a_closed_road_cannot_be_passed():
    assert demand.least_curvature(*road(20.0, low=1.0), ()) == float('inf')
