"""Tasks of the study: what they demand, as closed forms give it, and what controllers know."""

import numpy as np
import pytest

from experiments import drive_row, plant_limit
from experiments.drive_row import Row
from experiments.families import lane_change_task, plant_variant
from experiments.families.draw import draw
from experiments.families.lane_change_task import Area
from experiments.families.plant_variant import Variant
from mpcc_controller import car_file

NAME = lane_change_task.NAME
SEED = 3
WIDE = 1e3
AREA = Area(60.0, 0.5, 2.0, on_left=True)


@pytest.mark.parametrize('index', range(2))
def test_the_speed_of_a_task_takes_the_share_s_of_what_the_plant_holds(index):
    task = draw(NAME, SEED, index)
    setup = drive_row.prepare(Row(f'{NAME}:{index}', 'mpcc', seed=SEED), any_car=True)
    limit = plant_limit.lateral_limit(setup.plant)
    curvature = lane_change_task.required_curvature(task.values)
    assert curvature * task.values['speed_mps'] ** 2 == pytest.approx(
        task.values['S'] * limit, rel=1e-3
    )
    least, most = lane_change_task.SPEEDS
    assert least <= task.values['speed_mps'] <= most


def test_a_car_on_the_path_has_the_drawn_clearances():
    values, scn = draw(NAME, SEED, 0).values, draw(NAME, SEED, 0).scenario()
    path = np.column_stack([scn.reference.X, scn.reference.Y])
    for number, disc in enumerate(scn.obstacles.items, start=1):
        gap = np.hypot(*(path - (disc.X, disc.Y)).T).min() - disc.r_obs
        wanted = lane_change_task.CIRCLE_M + values[f'clearance_{number}_m']
        # the path bends away from the point beside which the obstacle stands
        assert wanted - 0.1 < gap < wanted + 0.01
    left, right = scn.edges.left[0, 1], scn.edges.right[0, 1]
    room = lane_change_task.CIRCLE_M + values['safety_edge_m']
    assert left - values['offset_m'] == pytest.approx(room + values['spare_left_m'], abs=1e-3)
    assert -right == pytest.approx(room + values['spare_right_m'], abs=1e-3)


def test_a_known_latency_is_added_to_the_lags_of_the_car_of_the_controller():
    variant = Variant('bmw_545i.yaml', 1.056, 0.6)
    own, known = (
        car_file.read(plant_variant.build(variant._replace(known_latency_s=latency)).car_file)
        for latency in (0.0, 0.05)
    )
    for lag in ('steer_lag_s', 'force_lag_s'):
        added = getattr(known.actuators, lag) - getattr(own.actuators, lag)
        assert added == pytest.approx(0.05, abs=2e-4)
    assert known.tyre == own.tyre


def road(length, low=-WIDE):
    """Return x and the bounds of y of a straight road."""
    x = np.arange(0.0, length + lane_change_task.STEP_M / 2, lane_change_task.STEP_M)
    return x, np.full(len(x), low), np.full(len(x), WIDE)


@pytest.mark.parametrize(('offset', 'length'), [(0.5, 30.0), (2.0, 60.0)])
def test_an_offset_with_any_heading_at_its_end_takes_a_constant_curvature(length, offset):
    """y = k L^2 / 2."""
    x, low, high = road(length)
    low[-1] = offset
    peak = lane_change_task.least_curvature(x, low, high, ())
    assert peak == pytest.approx(2.0 * offset / length**2, rel=1e-6)


def test_an_offset_that_must_be_kept_takes_twice_as_much():
    """To one side half of the way, to the other half of the way: y = k L^2 / 4."""
    offset, length = 2.0, 40.0
    x, low, high = road(2 * length)
    low[x >= length] = offset
    high[:] = offset
    peak = lane_change_task.least_curvature(x, low, high, ())
    # the end is required at grid points only, so the mass may use a part of the next step
    longest = length + lane_change_task.STEP_M
    assert 4.0 * offset / longest**2 < peak <= 4.0 * offset / length**2


def test_an_area_is_passed_on_its_side_and_the_other_side_is_the_mirror_image():
    mirrored = AREA._replace(y=-AREA.y, on_left=False)
    left, right = (
        lane_change_task.least_curvature(*road(80.0), [area]) for area in (AREA, mirrored)
    )
    assert left == pytest.approx(right)
    # the way to its edge abreast of its middle takes the most
    assert left == pytest.approx(2.0 * (AREA.y + AREA.radius) / AREA.x**2, rel=1e-6)


def test_a_closed_road_cannot_be_passed():
    assert lane_change_task.least_curvature(*road(20.0, low=1.0), ()) == float('inf')
