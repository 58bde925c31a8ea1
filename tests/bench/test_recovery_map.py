"""The map of slides: what a drive starts with, and how its end is judged."""

import numpy as np
import pytest
import recovery_map

from bags.storage.columns import Columns, names
from scenario_publisher import scenario
from vehicle_plant import parameters as plant_parameters


def odometry(sideslip_deg, yaw_rate, y=0.0, yaw=0.0, speed=20.0):
    """Return a drive of 2 s with a sideslip angle and a yaw rate, each a number or (n,)."""
    t = np.arange(0, 2, 0.01)
    given = (np.radians(sideslip_deg), yaw_rate, y, yaw)
    beta, r, Y, psi = (np.broadcast_to(values, t.shape) for values in given)
    values = (t * 1e9, t, speed * t, Y, psi, speed * np.cos(beta), speed * np.sin(beta), r)
    return Columns(**dict(zip(names('/vehicle/odometry'), values)))


@pytest.fixture(scope='module')
def plant():
    return plant_parameters.load()


def test_a_slide_moves_along_the_road_with_its_heading_off():
    slide = recovery_map.Slide(np.radians(20), -0.5, 25.0)
    start = scenario.parse(recovery_map.slide_scenario(slide), 'slide').start
    course = start.psi + np.arctan2(start.vy, start.speed)
    assert course == pytest.approx(0.0, abs=1e-12)
    assert np.hypot(start.speed, start.vy) == pytest.approx(25.0)
    assert start.r == -0.5


def test_a_car_that_is_calm_for_half_a_second_is_recovered_from_when_it_became_calm(plant):
    t = np.arange(0, 2, 0.01)
    end = recovery_map.ending(odometry(np.where(t < 0.7, 20.0, 1.0), 0.05), plant)
    assert end.recovered
    assert end.on_road
    assert end.settled_s == pytest.approx(0.7, abs=0.02)
    assert end.largest_sideslip_rad == pytest.approx(np.radians(20))


@pytest.mark.parametrize(
    ('sideslip', 'yaw_rate'),
    [(20.0, 0.0), (1.0, 0.3), (np.linspace(100, 0, 200), 0.0)],
    ids=['slides on', 'yaws on', 'spun first'],
)
def test_a_car_that_slides_yaws_or_has_spun_is_lost(plant, sideslip, yaw_rate):
    end = recovery_map.ending(odometry(sideslip, yaw_rate), plant)
    assert (end.recovered, end.on_road, end.settled_s) == (False, False, None)


def test_a_wheel_beyond_the_edge_is_off_the_road(plant):
    """Half of the track is 0.8 m: 3.5 m from the centre the outer wheels are beyond 4 m."""
    end = recovery_map.ending(odometry(0.0, 0.0, y=3.5), plant)
    assert (end.recovered, end.on_road) == (True, False)
    assert 4.1 < end.largest_offset_m < 4.5
    assert recovery_map.ending(odometry(0.0, 0.0, y=-2.9), plant).on_road


def test_the_grid_has_no_mirrored_slides_twice():
    slides = recovery_map.grid()
    assert len(set(slides)) == len(slides)
    assert min(s.sideslip_rad for s in slides) == 0.0
    assert all(s.yaw_rate_radps >= 0 for s in slides if s.sideslip_rad == 0)
