"""Random scenarios: no exception, valid commands and messages, and the right distances.

A fixed series, so that a failure is due to the change under test; its name has the number of the
draw. The first 29 run in `make check`: a fault that shows in one of ten scenarios is noticed with a
probability of 95 %. All 299 run each night: the same for a fault in one of a hundred. Another
series, or a longer one:

    RANDOM_SEED=7 RANDOM_SCENARIOS=1000 python -m pytest tests/closed_loop/test_random_scenarios.py
"""

import json
import math
import os

import numpy as np
import pytest
import random_scenarios

from bags.evaluation import metrics
from bags.evaluation.drive import drive_from_columns
from experiments import simulation
from msgs_yaml import conformance, encode
from msgs_yaml.types import Actuators, Command, Imu, VehicleState, Wheels
from vehicle_plant.gate import Gate
from vehicle_plant.state import SetPoints

DRAWS, IN_CHECK = int(os.environ.get('RANDOM_SCENARIOS', '299')), 29
SEED = int(os.environ.get('RANDOM_SEED', random_scenarios.SEED))
TICK_NS, PASSED = 50_000_000, 'passed'
NEAREST_M, MOVING_MPS = 1e-3, 3.0  # two evaluations; a slower car has no sideslip
ENCODE = {
    '/scenario/reference': encode.reference,
    '/scenario/road_edges': encode.road_edges,
    '/scenario/obstacles': encode.obstacles,
    '/controller/stop_plan': encode.stop_plan,
    '/controller/prediction': encode.prediction,
    '/controller/why': encode.why,
}
ENCODE_ROWS = {
    '/vehicle/odometry': (VehicleState, encode.odometry),
    '/vehicle/actuators': (Actuators, encode.actuators),
    '/vehicle/imu': (Imu, encode.imu),
    '/vehicle/wheels': (Wheels, encode.wheels),
    '/controller/command': (Command, encode.command),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    'index',
    [
        *range(min(DRAWS, IN_CHECK)),
        *(pytest.param(k, marks=pytest.mark.nightly) for k in range(IN_CHECK, DRAWS)),
    ],
)
def test_a_random_scenario_has_no_findings(index, tmp_path):
    draw = random_scenarios.draw(SEED, index)
    file = tmp_path / 'draw.yaml'
    file.write_text(draw.text)
    setup = simulation.prepare(str(file), draw.controller)
    scn = setup.scn._replace(
        start=draw.start or setup.scn.start, stop=setup.scn.stop._replace(time=draw.time_s)
    )
    setup = setup._replace(scn=scn)
    columns = simulation.run(setup)
    drive = drive_from_columns(columns, simulation.run_info(setup), setup.controller)
    values = metrics.compute_metrics(drive)
    json.dumps(values, allow_nan=False)
    assert [
        *not_finite(columns),
        *turned_back(columns['/controller/why']),
        *refused_by_the_plant(columns['/controller/command'], setup.plant, setup.friction),
        *over_friction(columns['/controller/command'], setup),
        *contract_broken(columns),
        *differences(columns, values, setup),
    ] == []


def not_finite(columns):
    for topic, table in columns.items():
        if not hasattr(table, 'values'):
            for name, column in vars(table).items():
                if not np.all(np.isfinite(column)):
                    yield f'{topic}: {name} is not finite'


def turned_back(whys):
    """Yield each command that the controller's own gate did not let through."""
    for k, why in enumerate(whys.values):
        if why.values['gate'] != PASSED:
            yield f'command {k}: turned back by the controller: {why.values["gate"]}'


def refused_by_the_plant(command, plant, friction):
    gate = Gate(plant, friction, SetPoints(0.0, 0.0, 0.0), int(command.stamp_ns[0]))
    for k, (stamp_ns, _, delta, d_delta, front, rear) in enumerate(zip(*command)):
        sent = Command(int(stamp_ns), delta, d_delta, front, rear)
        verdict = gate.check(sent, sent.stamp_ns, TICK_NS)
        if not verdict.accepted:
            yield f'command {k}: refused by the plant: {verdict.reason}'
    if not np.all(np.diff(command.stamp_ns) == TICK_NS):
        yield 'commands do not come once per tick'


def over_friction(command, setup):
    """Yield each axle that is asked for more than the friction that the controller believes."""
    car, tyre, believed = setup.vehicle.car, setup.vehicle.tyre, setup.params.model.friction
    moved = car.cog_height_m * (command.front_x_n + command.rear_x_n)  # N m, from axle to axle
    for name, force, arm, sign, friction in (
        ('front', command.front_x_n, car.cog_to_rear_m, -1.0, tyre.front_friction),
        ('rear', command.rear_x_n, car.cog_to_front_m, 1.0, tyre.rear_friction),
    ):
        load = (car.mass_kg * 9.81 * arm + sign * moved) / (car.cog_to_front_m + car.cog_to_rear_m)
        share = np.max(np.abs(force) / (friction * load))
        if not share <= believed * (1 + 1e-6):
            yield f'the {name} axle is asked for {share:.6f} of its friction, allowed {believed}'


def contract_broken(columns):
    """Yield each field that violates the contract, with the first such message.

    Of tables the rows with the minimum or maximum of a column are checked.
    """
    breaches = {}
    for topic, message in messages(columns):
        for breach in conformance.check(topic, message):
            breaches.setdefault((topic, breach.field), str(breach))
    yield from breaches.values()


def messages(columns):
    for topic, encoded in ENCODE.items():
        sent = columns[topic].values if topic in columns else ()  # no plan, no stop plan
        yield from ((topic, encoded(value)) for value in sent)
    for topic, (form, encoded) in ENCODE_ROWS.items():
        stamps, _, *fields = columns[topic]
        flat = np.column_stack(fields)
        for k in sorted({*np.argmin(flat, axis=0), *np.argmax(flat, axis=0)}):
            row = [tuple(map(float, f[k])) if f.ndim > 1 else float(f[k]) for f in fields]
            yield topic, encoded(form(int(stamps[k]), *row))


def differences(columns, values, setup):
    """Yield the metrics of obstacles and sideslip that are not those of plane geometry.

    It shares no code with `bags`; obstacles of several discs are left out.
    """
    o, messages = columns['/vehicle/odometry'], columns['/scenario/obstacles']
    car, body = setup.plant.car, setup.params.body
    front = car.body.cog_to_front_m + car.outline.front_overhang_m
    rear, width = car.body.cog_to_rear_m + car.outline.rear_overhang_m, car.outline.width_m
    radius, offsets = body.circle_radius_m, body.circle_offsets_m
    if body.circles:  # they cover the outline, each an equal share of it
        share = (front + rear) / body.circles
        radius = math.hypot(share / 2, width / 2)
        offsets = [(k + 0.5) * share - rear for k in range(body.circles)]
    turn = np.exp(-1j * o.yaw_rad)
    latest = np.maximum(np.searchsorted(messages.stamp_ns, o.stamp_ns, side='right') - 1, 0)
    circles, outline, all_gaps = {}, {}, []
    for row in np.unique(latest):
        now = latest == row
        age = (o.stamp_ns[now] - messages.stamp_ns[row]) / 1e9
        for item in messages.values[row].items:
            at = complex(item.X, item.Y) + age * complex(item.vX, item.vY)
            seen = (at - o.x_m[now] - 1j * o.y_m[now]) * turn[now]  # from the car: ahead, left
            gap = np.min([np.abs(seen - offset) for offset in offsets]) - radius - item.r_obs
            circles.setdefault(item.id, []).append(gap if not item.others else np.nan)
            beyond = abs(seen.real - (front - rear) / 2) - (front + rear) / 2
            aside = abs(seen.imag) - width / 2
            gap = np.hypot(np.maximum(beyond, 0), np.maximum(aside, 0))
            gap += np.minimum(np.maximum(beyond, aside), 0) - item.r_obs
            outline.setdefault(item.id, []).append(np.min(gap) if not item.others else np.nan)
    for name, found in (
        ('min_v2o_per_obstacle_m', circles),
        ('min_outline_gap_per_obstacle_m', outline),
    ):
        for number, gaps in found.items():
            least, told = min(gaps), values[name][str(number)]
            all_gaps.append(least)
            if least == least and abs(least - told) > NEAREST_M:
                yield f'{name} of {number} is {told}, plane geometry has {least}'
    least = np.min(all_gaps, initial=np.inf)  # not a number where one is not known
    if abs(least) > NEAREST_M and values['collided'] != (least < 0.0):
        yield f'collided is {values["collided"]}, the least gap is {least}'
    speed = np.hypot(o.vx_mps, o.vy_mps)
    moving, told = speed > MOVING_MPS, values['peak_sideslip_deg']
    if moving.any():
        slip = np.degrees(np.arccos(np.clip(o.vx_mps[moving] / speed[moving], -1, 1)).max())
        if abs(slip - told) > 0.01 or values['lost'] != (slip > 30.0):
            yield f'peak_sideslip_deg is {told}, plane geometry has {slip}'
