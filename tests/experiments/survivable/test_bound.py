"""What friction makes impossible, against closed forms and drives that were survived."""

import pytest

from experiments.survivable import bound
from experiments.survivable.emergency import Emergency
from msgs_yaml.types import Command

GRAVITY = 9.81


def wall(x):
    """Return discs across the whole road."""
    return [{'x_m': x, 'y_m': -2.5 + 1.7 * i, 'radius_m': 1.0} for i in range(6)]


def test_a_car_that_brakes_at_its_limit_stops_within_the_distance_of_a_point(straight_emergency):
    """Within 10 % of v^2 / 2 a, before which nothing stops and behind which a point does."""
    speed = 20.0
    setup = straight_emergency(speed, wall(100.0))
    a = bound.greatest_acceleration(Emergency(setup))
    half_width, radius = setup.plant.car.outline.width_m / 2, 1.0
    stop = speed**2 / (2 * a) + half_width + radius

    def verdict(distance):
        return bound.impossible_at(Emergency(straight_emergency(speed, wall(distance))))

    assert verdict(0.9 * stop) is not None
    assert verdict(1.1 * stop) is None


def test_nothing_moves_aside_faster_than_friction_allows(straight_emergency):
    """A disc ahead can be left on one side only when a t^2 / 2 is at least its half width."""
    speed, radius = 25.0, 1.2

    def verdict(time_s):
        appears = {'x_m': 25.0 + speed * time_s, 'y_m': 0.0, 'radius_m': radius}
        return bound.impossible_at(
            Emergency(straight_emergency(speed, [appears | {'appears_at_s': 1.0}]))
        )

    needed = (2 * (radius + 0.925) / (1.05 * GRAVITY)) ** 0.5
    assert verdict(0.8 * needed) is not None
    assert verdict(1.3 * needed) is None


def test_on_an_empty_road_nothing_is_impossible(straight_emergency):
    assert bound.impossible_at(Emergency(straight_emergency(20.0, []))) is None


def test_less_friction_makes_more_impossible(straight_emergency):
    obstacles = wall(36.0)
    assert bound.impossible_at(Emergency(straight_emergency(20.0, obstacles))) is None
    slippery = straight_emergency(20.0, obstacles, friction=0.4)
    assert bound.impossible_at(Emergency(slippery)) is not None


@pytest.mark.parametrize('speed', [12.0, 24.0])
def test_the_bound_on_the_acceleration_is_above_what_the_plant_reaches(straight_emergency, speed):
    setup = straight_emergency(speed, [])
    emergency = Emergency(setup)
    most = bound.greatest_acceleration(emergency)
    for front, rear, delta in ((-12000, -6000, 0.0), (0, 0, 0.12), (-6000, -3000, 0.1)):
        rollout = emergency.roll(
            lambda car, _, F=(front, rear), delta=delta: Command(car.stamp_ns, delta, 0.0, *F), 30
        )
        names = ('acceleration.ax', 'acceleration.ay')
        ax, ay = (
            [float(abs(piece.column(name)).mean()) for piece in rollout.pieces] for name in names
        )
        reached = max((x**2 + y**2) ** 0.5 for x, y in zip(ax, ay))
        assert 0.5 * most < reached < most
