"""Drawn points as settings: the course, the plant, and the speed at which the task demands S."""

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from bags.evaluation.geometry import Outline
from bags.evaluation.vehicle_shape import circles_of
from experiments.batch import distributions
from experiments.settings import course, plant_variants
from experiments.settings.plan import Plan
from experiments.settings.plant_variants import Plant
from scenario_publisher import scenario
from scenario_publisher.scenario import ScenarioError

# why a drawn point is no setting
TOO_NEAR = 'a safety distance cannot be kept'
TOO_SLOW, TOO_FAST = 'too slow', 'too fast'
NOT_BUILT = 'no scenario'


class Setting(NamedTuple):
    """One admissible point; it can be sent to another process."""

    number: int  # of the point in the Sobol sequence, from 0
    values: Mapping[str, Any]  # by name of the dimension
    curvature: float  # 1/m, least peak that the task demands
    speed: float  # m/s, desired and at the start
    text: str  # of the scenario
    plant: Plant
    radius: float  # m, of the vehicle circles
    offsets: tuple[float, ...]  # m ahead of the centre of gravity, one circle each
    second_at: float  # m, station of obstacle 2

    def __repr__(self) -> str:
        return f'Setting({self.number}, S={self.values["S"]:.2f}, {self.speed:.1f} m/s)'


class Rejected(NamedTuple):
    """A drawn point that is no setting."""

    number: int
    values: Mapping[str, Any]
    reason: str  # one of those above


def draw(plan: Plan, seed: int, first: int, count: int) -> list[dict[str, Any]]:
    """Return the values of the points `first` to `first + count - 1` of the sequence of a seed."""
    return distributions.sample(plan.dimensions, count, seed, first)


def build(plan: Plan, number: int, values: Mapping[str, Any]) -> Setting | Rejected:
    """Return the setting of a drawn point, or why it is none."""
    # before anything is computed: a car on the path is nearer to the right edge than allowed
    if values['room_right_m'] < values['safety_edge_m']:
        return Rejected(number, values, TOO_NEAR)
    plant = plant_variants.build(plant_variants.variant_of(values))
    radius, offsets = vehicle_circles(values['circles'], plant, plan.circles)
    try:
        curvature = course.required_curvature(values, radius, plan.course)
    except ValueError:  # a change that is too short for its offset
        return Rejected(number, values, NOT_BUILT)
    if not math.isfinite(curvature):
        return Rejected(number, values, TOO_NEAR)
    speed = speed_of(values['S'], plant.limit, curvature)
    if speed < plan.admissible.least_speed_mps:
        return Rejected(number, values, TOO_SLOW)
    if speed > plan.admissible.greatest_speed_mps:
        return Rejected(number, values, TOO_FAST)
    layout = course.lay_out(values, radius, course.entry_of(plan.course, speed))
    text = course.scenario_text(layout, speed, plan.course)
    try:
        scenario.parse(text, course.NAME)
    except ScenarioError:
        return Rejected(number, values, NOT_BUILT)
    at = layout.second_at
    return Setting(number, values, curvature, speed, text, plant, radius, offsets, at)


def build_range(plan: Plan, seed: int, first: int, count: int) -> list[Setting | Rejected]:
    """Return the settings of consecutive points, or why they are none."""
    drawn = enumerate(draw(plan, seed, first, count), start=first)
    return [build(plan, number, values) for number, values in drawn]


def vehicle_circles(count: int, plant: Plant, circles: Plan) -> tuple[float, tuple[float, ...]]:
    """Return radius and offsets [m] of the vehicle circles.

    One is that of the paper, at the centre of gravity; two are those of the baseline's lineage,
    about the middle of the outline; three cover the outline.
    """
    if count == 1:
        return circles.radius_m, (0.0,)
    if count == 2:
        middle, half = (plant.front - plant.rear) / 2, circles.apart_m / 2
        return circles.radius_m, (middle - half, middle + half)
    outline = Outline(plant.front, plant.rear, plant.width)
    return circles_of({'body.circles': count}, outline)


def speed_of(S: float, limit: float, curvature: float) -> float:
    """Return the speed [m/s] at which a curvature [1/m] takes S of a lateral limit [m/s^2]."""
    return math.sqrt(S * limit / curvature) if curvature > 0.0 else math.inf


def describe(setting: Setting) -> Iterator[tuple[str, Any]]:
    """Yield the columns of the table that every drive of a setting has."""
    yield from setting.values.items()
    yield 'plant_limit_mps2', setting.plant.limit
    yield 'required_curvature_1pm', setting.curvature
    yield 'speed_mps', setting.speed
    yield 'circle_radius_m', setting.radius
    yield 'obstacle_2_at_m', setting.second_at
