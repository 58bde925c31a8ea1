"""The linear program finds what closed forms of a point mass give."""

import numpy as np
import pytest

from experiments.settings import demand
from experiments.settings.demand import Circle, Task

SPEED = 20.0
WIDE = 1e3


def road(length, low=-WIDE, high=WIDE, circles=()):
    x = np.arange(0.0, length + demand.STEP_M / 2, demand.STEP_M)
    return Task(x, np.full(len(x), low), np.full(len(x), high), tuple(circles))


@pytest.mark.parametrize('offset', [0.5, 2.0])
@pytest.mark.parametrize('length', [30.0, 60.0])
def test_an_offset_with_any_heading_at_its_end_takes_a_constant_acceleration(length, offset):
    """y = a (L / v)^2 / 2."""
    task = road(length)
    low = task.low.copy()
    low[-1] = offset
    assert demand.least_peak(task._replace(low=low), SPEED) == pytest.approx(
        2.0 * offset * (SPEED / length) ** 2, rel=1e-6
    )


def test_an_offset_that_must_be_kept_takes_twice_as_much():
    """Accelerate half of the way, brake the lateral motion half of the way: y = a (L / v)^2 / 4."""
    offset, length = 2.0, 40.0
    task = road(2 * length)
    low, high = task.low.copy(), task.high.copy()
    low[task.x >= length] = offset
    high[:] = offset
    peak = demand.least_peak(task._replace(low=low, high=high), SPEED)
    # the end is required at grid points only, so the mass may use a part of the next step
    longest = length + demand.STEP_M
    assert 4.0 * offset * (SPEED / longest) ** 2 < peak <= 4.0 * offset * (SPEED / length) ** 2


def test_the_acceleration_grows_with_the_square_of_the_speed():
    task = road(80.0, circles=[Circle(60.0, 0.5, 2.0, on_left=True)])
    slow, fast = demand.least_peak(task, 10.0), demand.least_peak(task, 30.0)
    assert fast == pytest.approx(9.0 * slow, rel=1e-6)


def test_passing_on_the_other_side_is_the_mirror_image():
    left = road(80.0, circles=[Circle(60.0, 0.5, 2.0, on_left=True)])
    right = road(80.0, circles=[Circle(60.0, -0.5, 2.0, on_left=False)])
    assert demand.least_peak(left, SPEED) == pytest.approx(demand.least_peak(right, SPEED))


def test_less_preview_never_takes_less():
    task = road(80.0, circles=[Circle(60.0, 0.5, 2.0, on_left=True)])
    peaks = [demand.least_peak(task, SPEED, start) for start in (0.0, 10.0, 20.0, 40.0)]
    assert peaks == sorted(peaks)
    assert peaks[-1] > 2.0 * peaks[0]


def test_a_closed_road_cannot_be_passed():
    assert demand.least_peak(road(20.0, low=1.0), SPEED) == float('inf')
