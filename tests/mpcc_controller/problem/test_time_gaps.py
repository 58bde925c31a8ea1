"""Who is ahead of a plan, and what it costs to be nearer than the time gap, on a straight road."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.model.single_track import State
from mpcc_controller.problem import time_gaps
from msgs_yaml.types import Obstacle

GAP_S, LACK_M, SPEED, RADIUS = 1.5, 2.0, 20.0, 1.0
FAR = time_gaps.FAR_M
PATH, LEFT, RIGHT = range(3)


@pytest.fixture(scope='module')
def behind(world, pose):
    """Return behind(obstacles, y) -> Posed: a car of three circles at x = 50 m, at 20 m/s."""

    def make(*obstacles, y=0.0):
        crowd = [Obstacle(k, X, Y, RADIUS, vX, vY) for k, (X, Y, vX, vY) in enumerate(obstacles)]
        return pose(
            State(50.0, y, 0.0, SPEED, 0.0, 0.0, 50.0, 0.0, 0.0),
            'mpcc_road',
            scene=world.scene(world.straight(obstacles=crowd)),
            drives=True,
            envelope__time_gap_s=GAP_S,
            tolerances__time_gap_lack_m=LACK_M,
        )

    return make


def nose_of(posed):
    body = posed.form.params.body
    return max(body.circle_offsets_m) + body.circle_radius_m


@pytest.mark.parametrize(
    ('obstacle', 'strip', 'closing'),
    [
        ((80.0, 0.5, 10.0, 0.0), PATH, 0.0),
        ((80.0, 3.5, 10.0, 0.0), LEFT, 0.0),
        # one who comes gets nearer by twice the gap, and in the strip of the path is an emergency
        ((90.0, 3.5, -15.0, 0.0), LEFT, 2 * GAP_S * 15.0),
        ((90.0, -3.5, -15.0, 0.0), RIGHT, 2 * GAP_S * 15.0),
        ((90.0, 0.5, -15.0, 0.0), None, 0.0),
        ((80.0, 0.5, 0.0, 0.0), None, 0.0),  # stands
        ((80.0, 0.5, 0.0, 5.0), None, 0.0),  # crosses
        ((45.0, 0.5, 10.0, 0.0), None, 0.0),  # is behind
    ],
)
def test_who_is_ahead_in_which_strip(behind, obstacle, strip, closing):
    posed = behind(obstacle)
    for number, lead in enumerate(posed.numbers.stages.leads):
        rear = obstacle[0] - RADIUS - nose_of(posed) - closing
        assert lead.theta[0] == (pytest.approx(rear, abs=1e-6) if number == strip else FAR)


def test_the_next_one_ahead_counts_and_passes_out_of_sight_stage_by_stage(behind):
    """The car at 20 m/s is where the one at 5 m/s was within the horizon; the next one remains."""
    near, far = (65.0, 3.5, 5.0, 0.0), (95.0, 3.5, 19.0, 0.0)
    posed = behind(near, far)
    lead, t = posed.numbers.stages.leads[LEFT], 0.05 * np.arange(51)
    rears = [X + v * t - RADIUS - nose_of(posed) for X, _, v, _ in (near, far)]
    expected = np.where(rears[0] > 50.0 + SPEED * t, *rears)
    assert lead.theta == pytest.approx(expected, abs=1e-4)
    assert np.any(expected != rears[0])


@settings(max_examples=30)
@given(st.floats(60.0, 120.0), st.floats(-3.0, 3.0), st.floats(2.0, 30.0))
def test_it_costs_the_square_of_the_gap_that_lacks_within_the_strip_of_the_one_ahead(
    behind, ahead, aside, speed
):
    posed = behind((ahead, 0.5, speed, 0.0), y=aside)
    lacks = GAP_S * SPEED - (ahead - RADIUS - nose_of(posed) - 50.0)
    # whole from where the outlines are beside each other, to nothing 0.5 m beyond that
    body = posed.form.params.body
    touch = RADIUS + (body.edge_radius_m or body.circle_radius_m)
    inside = np.clip((touch + 0.5 - abs(aside - 0.5)) / 0.5, 0.0, 1.0)
    expected = (max(lacks, 0.0) * inside / LACK_M) ** 2
    cost = float(posed.values().costs.time_gap[0])
    assert cost == pytest.approx(expected, rel=1e-3, abs=1e-2)
