"""Distances on a circle in two frames, against numbers made elsewhere and plane geometry."""

import json

import numpy as np
import pytest
from straight_drive import obstacle

from bags.errors import BagError
from bags.figures import frame_distances

RADIUS, REACH, SPEED = 20.0, 2.1, 9.0
GAPS = np.array([2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0])


@pytest.mark.parametrize(
    ('radius', 'inside', 'known'),
    [
        (20.0, 1.0, [0.05, 0.14, 0.35, 0.72, 1.31, 3.42, 7.19]),
        (20.0, -1.0, [-0.04, -0.11, -0.14, -0.01, 0.35, 2.06, 5.51]),
        (50.0, 1.0, [0.02, 0.05, 0.12, 0.21, 0.33, 0.74, 1.45]),
        (50.0, -1.0, [-0.02, -0.05, -0.08, -0.09, -0.06, 0.15, 0.67]),
        (200.0, 1.0, [0.00, 0.01, 0.03, 0.04, 0.06, 0.10, 0.17]),
    ],
)
def test_the_overestimation_has_the_known_values(radius, inside, known):
    result = frame_distances.circle_distances(radius, GAPS, inside, REACH).overestimation
    assert result == pytest.approx(np.array(known), abs=0.006)


def test_the_sign_turns_at_one_gap_outside_the_circle_and_at_none_inside():
    assert frame_distances.turning_gap(RADIUS, 1.0) == 0.0
    turn = frame_distances.turning_gap(RADIUS, -1.0)
    assert turn == pytest.approx(15.27, abs=0.01)
    near, far = (
        frame_distances.circle_distances(RADIUS, turn + d, -1.0, REACH) for d in (-0.1, 0.1)
    )
    assert near.overestimation < 0 < far.overestimation


def lap(make_drive, turn=1.0, beside=0.0, obstacles=1):
    """Return a drive around a circle, `beside` metres inside its path, past an obstacle."""
    s = np.arange(0.0, 150.0, 0.5)

    def at(s, inside):
        reach = RADIUS - inside
        return reach * np.sin(s / RADIUS), turn * (RADIUS - reach * np.cos(s / RADIUS))

    places = [at(60.0 + 5.0 * k, 1.0) for k in range(obstacles)]
    result = make_drive(metres=100.0)
    crowd = tuple(obstacle(k, *place) for k, place in enumerate(places))
    scene = result.scene._replace(reference=np.column_stack(at(s, 0.0)), obstacles=crowd)
    x, y = at(1.2 * result.motion.x, beside)
    yaw = turn * 1.2 * result.motion.x / RADIUS
    return result._replace(motion=result.motion._replace(x=x, y=y, yaw=yaw), scene=scene)


@pytest.mark.parametrize('turn', [1.0, -1.0])
def test_recorded_poses_give_the_closed_forms_of_where_they_are(make_drive, turn):
    result = lap(make_drive, turn, beside=0.3)
    circle = frame_distances.find_circle(result)
    assert (circle.radius, circle.turn) == (pytest.approx(RADIUS), turn)
    assert (circle.station, circle.inside, circle.reach) == pytest.approx((60.0, 1.0, REACH))
    driven = frame_distances.driven_distances(result, circle)
    assert driven.inside == pytest.approx(np.full(len(driven.inside), 0.3), abs=1e-9)
    assert driven.station == pytest.approx(np.linspace(0.0, 120.0, 5001), abs=1e-9)
    for side, own in driven.distances.items():
        gap, inside = driven.station - circle.station, circle.sides[side]
        closed = frame_distances.circle_distances(RADIUS, gap, inside, REACH, driven.inside)
        assert own.cartesian == pytest.approx(closed.cartesian, abs=1e-9)
        assert own.frenet == pytest.approx(closed.frenet, abs=1e-9)


def test_figure_and_numbers_of_a_drive_are_written(make_drive, tmp_path):
    values, files = frame_distances.write_frame_distances(lap(make_drive), tmp_path)
    assert json.loads(files['numbers'].read_text()) == values
    for suffix in ('.png', '.svg'):
        assert files['figure'].with_suffix(suffix).stat().st_size > 10_000
    recorded = values['recorded']
    assert recorded['collided']
    assert recorded['min_v2o_m'] == pytest.approx(1.0 - REACH, abs=2e-3)
    for side in ('inside', 'outside'):
        closed = values['overestimation_m'][side]
        assert recorded['overestimation_m'][side] == pytest.approx(closed, abs=2e-3)


@pytest.mark.parametrize('why', ['one obstacle', 'no circle', 'moves'])
def test_other_drives_have_no_such_figure(make_drive, why):
    result = lap(make_drive, obstacles=2 if why == 'one obstacle' else 1)
    scene, item = result.scene, result.scene.obstacles[0]
    if why == 'no circle':
        scene = scene._replace(reference=np.column_stack([np.arange(100.0), np.zeros(100)]))
    if why == 'moves':
        moving = item._replace(x=item.x + np.linspace(0.0, 3.0, len(item.x)))
        scene = scene._replace(obstacles=(moving,))
    with pytest.raises(BagError, match=why):
        frame_distances.find_circle(result._replace(scene=scene))
