"""What to tell a user before a run: where scenario, controller and plant do not suit each other.

All of it is allowed and may be what an experiment is about; so these are warnings, not errors.
"""

from collections.abc import Sequence
from typing import NamedTuple

from experiments.configuration.experiment import ScenarioFacts
from mpcc_controller import least_speed, limits_in_force
from mpcc_controller.parameters import CarParams, ControllerParams
from vehicle_plant import capability
from vehicle_plant.parameters import PlantParams

START, PLANT_START = 'start.', 'plant.start.speed_mps'
SHARE_TOLERANCE = 0.05  # of the drive at the front axle


class Slow(NamedTuple):
    """How a warning about a kind of speed is worded."""

    what: str  # begins it
    margin_mps: float  # above the least speed that is warned of, too
    below: str  # what the car does below the least speed
    near: str  # and within the margin


START_SLOW = Slow(
    'the car starts at',
    least_speed.START_MARGIN_MPS,
    'does not pull away',
    'may not pull away',
)
DESIRED_SLOW = Slow(
    'the scenario asks for',
    least_speed.DESIRED_MARGIN_MPS,
    'stops where it is so',
    'may stop where it is so',
)


def of(
    facts: ScenarioFacts,
    start_mps: float,
    controller: tuple[ControllerParams, CarParams],
    plant: PlantParams,
) -> list[str]:
    """Return the warnings about a run, each one line, none where all suits.

    `start_mps` is the speed at which the plant starts the car, the scenario's unless it was set.
    """
    params, vehicle = controller
    desired = [(key, speed) for key, speed in facts.speeds if not key.startswith(START)]
    given = [key for key, _ in facts.speeds if key.startswith(START)]
    is_set = start_mps != facts.start['speed_mps']
    # a start that nobody gives is the desired speed there, which is looked at anyway
    start = [(PLANT_START if is_set else given[0], start_mps)] if is_set or given else []
    least = params.limits.least_speed_mps
    return [
        *slow_speeds(START_SLOW, start, least),
        *slow_speeds(DESIRED_SLOW, desired, least),
        *drive_layout(params, vehicle, plant),
        *filter(None, [limits_in_force.told(params, vehicle)]),
    ]


def slow_speeds(kind: Slow, speeds: Sequence[tuple[str, float]], least_mps: float) -> list[str]:
    """Return a warning about speeds at which a controller stops, none where it drives.

    `speeds` are (key, m/s), `least_mps` is limits.least_speed_mps of the controller.
    """

    def relation(speed):
        return least_speed.relation(speed, least_mps, kind.margin_mps)

    slow = [one for one in speeds if relation(one[1])]
    if not slow:
        return []
    (key, speed), more = min(slow, key=lambda one: one[1]), len(slow) - 1
    others = f' and {more} more' if more else ''
    then = kind.below if relation(speed) == least_speed.BELOW else kind.near
    return [
        f'{kind.what} {speed:g} m/s ({key}{others}), {relation(speed)} the '
        f'limits.least_speed_mps of {least_mps:g} m/s: the controller brakes to a stop '
        f'below that speed, so the car {then}'
    ]


def drive_layout(params: ControllerParams, vehicle: CarParams, plant: PlantParams) -> list[str]:
    """Return a warning where the controller drives other axles than the plant."""
    share, key = params.model.drive_front_share, 'model.drive_front_share'
    if share is None:
        share, key = vehicle.actuators.drive_front_share, f'car_file {params.car_file}'
    driven = capability.of(plant.car).drive_front_share
    if abs(share - driven) <= SHARE_TOLERANCE:
        return []
    return [
        f'the controller believes that {share:.0%} of the drive is at the front axle ({key}), the '
        f'plant has {driven:.0%} there: give controller.car_file a file that identify made of it'
    ]
