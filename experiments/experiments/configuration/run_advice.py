"""What is rarely meant in the inputs of a run: in the scenario, and between controller and plant.

All of it is allowed, since it may be the subject of the experiment.
"""

import math
from collections.abc import Mapping
from typing import Any

from mpcc_controller import in_force
from mpcc_controller.parameters import CarParams, ControllerParams
from scenario_publisher import advice, scenario
from scenario_publisher.advice import Advice
from scenario_publisher.scenario import Scenario
from vehicle_plant.car import actuator_limits
from vehicle_plant.parameters import PlantParams

START, PLANT_START = 'start.', 'plant.start.speed_mps'
SHARE_TOLERANCE = 0.05  # of the drive force at the front axle
REACHED_SHARE = 0.95  # of a desired speed: so much counts as reached


def find_warnings(scn: Scenario, source: str, checked: Mapping[str, tuple[Any, Any]]) -> list[str]:
    """Return one line for what is rarely meant in a scenario and for each mismatch, [] without.

    `source` is its name or file, `checked` is from `inputs.check_parameters`.
    """
    (params, vehicle), (_, plant) = checked['controller'], checked['plant']
    return [
        *advice.flatten(judge(scn, source, checked)),
        *filter(None, [_drive_layout(params, vehicle, plant)]),
        *in_force.describe_changes(params, vehicle),
    ]


def judge(scn: Scenario, source: str, checked: Mapping[str, tuple[Any, Any]]) -> list[Advice]:
    """Return what is looked at in a scenario for a controller and a plant, with the warnings.

    The arguments are those of `find_warnings`.
    """
    (params, vehicle), (node, plant) = checked['controller'], checked['plant']
    start_mps = node.start.speed_mps
    desired = [(key, speed) for key, speed in scn.speeds if not key.startswith(START)]
    given = [key for key, _ in scn.speeds if key.startswith(START)]
    is_set = start_mps != scn.start.speed
    # without a start speed of its own the scenario starts at the desired speed, checked anyway
    start = [(PLANT_START if is_set else given[0], start_mps)] if is_set or given else []
    params = in_force.with_stable_speed(params, vehicle)
    least = params.limits.least_speed_mps
    start_words = ('the car starts at', 'does not pull away', 'may not pull away')
    desired_words = ('the scenario asks for', 'stops where it is so', 'may stop where it is so')
    slow = [
        *_slow_speed(start, least, in_force.START_MARGIN_MPS, *start_words),
        *_slow_speed(desired, least, in_force.DESIRED_MARGIN_MPS, *desired_words),
    ]
    drive_n = min(
        vehicle.actuators.drive_n, params.limits.drive_n, actuator_limits(plant.car).drive_n
    )
    fast = _unreached_speed(scn, desired, start_mps, drive_n, plant.car.body)
    named = scenario.describe_namesake(source, scn)
    return [
        *advice.judge(scn, params.model.horizon * params.model.step_s),
        Advice('no speed is so low that the controller stops', tuple(slow)),
        Advice('the car can reach the desired speed', tuple(fast)),
        Advice('no other scenario has its name', (named,) if named else ()),
    ]


def _unreached_speed(scn, desired, start_mps, drive_n, body):
    """Return the warning that the greatest desired speed is not reached, at most one.

    On a straight road, with all of the drive force `drive_n` [N] from the start on.
    """
    asked = float(advice.driven_demand(scn).speed.max())
    # a speed table may be sampled between its rows
    key = next((key for key, speed in desired if math.isclose(speed, asked, rel_tol=1e-3)), 'speed')
    if start_mps >= asked:
        return []
    drag = body.air_density_kgpm3 / 2 * body.drag_area_m2
    finish = advice.finish_station(scn) - advice.start_station(scn)
    # v dv/ds = (F - drag v^2) / m, solved for v^2
    rate = 2.0 * drag / body.mass_kg
    gain = 2.0 * drive_n / body.mass_kg * (-math.expm1(-rate * finish) / rate if rate else finish)
    reached = math.sqrt(start_mps**2 * math.exp(-rate * finish) + gain)
    if reached >= REACHED_SHARE * asked:
        return []
    return [
        f'the scenario asks for up to {asked:g} m/s ({key}): from {start_mps:g} m/s the car comes '
        f'to {reached:.0f} m/s at most before the finish line, with {drive_n:.0f} N of drive'
    ]


def _slow_speed(speeds, least_mps, margin_mps, subject, below, near):
    """Return the warning about speeds (key, m/s) at which the controller stops, at most one.

    `below` and `near` describe the car below the least speed and within the margin above it.
    """
    compared = (
        (speed, key, in_force.compare_speed(speed, least_mps, margin_mps)) for key, speed in speeds
    )
    slow = [entry for entry in compared if entry[2]]
    if not slow:
        return []
    speed, key, relation = min(slow, key=lambda entry: entry[0])
    others = f' and {len(slow) - 1} more' if len(slow) > 1 else ''
    consequence = below if relation == in_force.BELOW else near
    return [
        f'{subject} {speed:g} m/s ({key}{others}), {relation} the '
        f'limits.least_speed_mps of {least_mps:g} m/s: the controller brakes to a stop '
        f'below that speed, so the car {consequence}'
    ]


def _drive_layout(params: ControllerParams, vehicle: CarParams, plant: PlantParams):
    """Return the warning that the controller drives other axles than the plant, or ''."""
    share, key = params.model.drive_front_share, 'model.drive_front_share'
    if share is None:
        share, key = vehicle.actuators.drive_front_share, f'car_file {params.car_file}'
    driven = actuator_limits(plant.car).drive_front_share
    if abs(share - driven) <= SHARE_TOLERANCE:
        return ''
    return (
        f'the controller believes that {share:.0%} of the drive is at the front axle ({key}), the '
        f'plant has {driven:.0%} there: give controller.car_file a file that identify wrote for it'
    )
