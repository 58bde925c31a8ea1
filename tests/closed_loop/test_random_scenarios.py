"""Random scenarios: no exception, valid commands and messages, and the right verdict.

A fixed series, so that a failure is due to the change under test; its name has the number of the
draw. The first 29 run in `make check`: a fault that shows in one of ten scenarios is noticed with a
probability of 95 %. All 299 run each night: the same for a fault in one of a hundred. Another
series, or a longer one:

    RANDOM_SEED=7 RANDOM_SCENARIOS=1000 python -m pytest tests/closed_loop/test_random_scenarios.py
"""

import json
import math
import os

import independent_evaluation
import numpy as np
import pytest
import random_scenarios
from independent_evaluation import Body, Motion

from bags.evaluation import metrics
from bags.evaluation.drive import drive_from_columns
from experiments import simulation
from msgs_yaml import conformance, encode
from msgs_yaml.types import Actuators, Command, Imu, VehicleState, Wheels
from vehicle_plant.gate import Gate
from vehicle_plant.state import SetPoints

DRAWS, IN_CHECK = int(os.environ.get('RANDOM_SCENARIOS', '299')), 29
SEED = int(os.environ.get('RANDOM_SEED', random_scenarios.SEED))
# share of runs that the independent evaluation may leave undecided, since they end near the finish
# line
UNSURE = 0.25
TICK_S, GRAVITY = 0.05, 9.81
NEAREST = 1e-3  # m, between two evaluations of one number
# m and deg; each evaluation samples the outline at points of its own
NEAR = {'beyond_edge_m': 0.1, 'peak_sideslip_deg': 0.01}
VERDICTS = ('completed', 'collided', 'left_road', 'lost', 'spun')
ROUNDING = 1e-6  # relative, of a command on its limit
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


@pytest.fixture(scope='module')
def undecided():
    """The verdicts that the independent evaluation left open, by draw: it must stay rare."""
    open_verdicts = {}
    yield open_verdicts
    many = [draw for draw, names in open_verdicts.items() if names]
    assert len(many) <= UNSURE * len(open_verdicts) + 2, many


@pytest.mark.slow
@pytest.mark.parametrize(
    'index',
    [
        *range(min(DRAWS, IN_CHECK)),
        *(pytest.param(k, marks=pytest.mark.nightly) for k in range(IN_CHECK, DRAWS)),
    ],
)
def test_a_random_scenario_has_no_findings(index, tmp_path, undecided):
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
    second = evaluate(setup, columns['/vehicle/odometry'])
    undecided[index] = [key for key in VERDICTS if getattr(second, key) is None]
    assert [
        *not_finite(columns),
        *limits_broken(columns, setup.params, setup.vehicle),
        *refused_by_the_plant(columns['/controller/command'], setup.plant, setup.friction),
        *contract_broken(columns),
        *differences(second, values, setup.params),
    ] == []


def evaluate(setup, odometry):
    car, body = setup.plant.car, setup.params.body
    front = car.body.cog_to_front_m + car.outline.front_overhang_m
    rear, width = car.body.cog_to_rear_m + car.outline.rear_overhang_m, car.outline.width_m
    radius, offsets = body.circle_radius_m, tuple(body.circle_offsets_m)
    if body.circles:  # they cover the outline, each an equal share of it
        share = (front + rear) / body.circles
        radius = math.hypot(share / 2, width / 2)
        offsets = tuple((k + 0.5) * share - rear for k in range(body.circles))
    o = odometry
    motion = Motion(o.stamp_ns, o.x_m, o.y_m, o.yaw_rad, o.vx_mps, o.vy_mps)
    return independent_evaluation.evaluate(
        setup.scn, motion, Body(front, rear, width, radius, offsets)
    )


def not_finite(columns):
    for topic, table in columns.items():
        if not hasattr(table, 'values'):
            for name, column in vars(table).items():
                if not np.all(np.isfinite(column)):
                    yield f'{topic}: {name} is not finite'


def limits_broken(columns, params, vehicle):
    """Yield the limits of the controller's parameters that the commands violate."""
    command, limits, car = columns['/controller/command'], params.limits, vehicle.car
    force = command.front_x_n + command.rear_x_n
    steer_step = np.diff(command.steer_rad, prepend=0.0)
    force_step = np.diff(force, prepend=0.0)
    weight, wheelbase = car.mass_kg * GRAVITY, car.cog_to_front_m + car.cog_to_rear_m
    front = (weight * car.cog_to_rear_m - car.cog_height_m * force) / wheelbase
    rear = (weight * car.cog_to_front_m + car.cog_height_m * force) / wheelbase
    believed = params.model.friction
    of_grip = {
        'front force over friction': command.front_x_n / (vehicle.tyre.front_friction * front),
        'rear force over friction': command.rear_x_n / (vehicle.tyre.rear_friction * rear),
    }
    bounds = {
        'steer': (command.steer_rad, -limits.steer_rad, limits.steer_rad),
        'steer rate': (steer_step / TICK_S, -limits.steer_rate_radps, limits.steer_rate_radps),
        'force': (force, -limits.brake_n, limits.drive_n),
        'force rate': (force_step / TICK_S, -limits.force_rate_nps, limits.force_rate_nps),
        **{name: (share, -believed, believed) for name, share in of_grip.items()},
    }
    for name, (values, low, high) in bounds.items():
        spare = ROUNDING * (high - low)
        bad = np.flatnonzero(~((low - spare <= values) & (values <= high + spare)))
        if bad.size:
            yield f'command {bad[0]}: {name} is {values[bad[0]]:.9g}, allowed {low:g} to {high:g}'
    if not np.all(np.diff(command.stamp_ns) == round(TICK_S * 1e9)):
        yield 'commands do not come once per tick'


def refused_by_the_plant(command, plant, friction):
    gate = Gate(plant, friction, SetPoints(0.0, 0.0, 0.0), int(command.stamp_ns[0]))
    for k, (stamp_ns, _, delta, d_delta, front, rear) in enumerate(zip(*command)):
        sent = Command(int(stamp_ns), delta, d_delta, front, rear)
        verdict = gate.check(sent, sent.stamp_ns, round(TICK_S * 1e9))
        if not verdict.accepted:
            yield f'command {k}: refused by the plant: {verdict.reason}'


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


def differences(second, values, params):
    """Yield the differences between the metrics and the independent evaluation."""
    gaps = values['min_v2o_per_obstacle_m']
    pairs = [('min_outline_gap_m', second.outline, values['min_outline_gap_m'])]
    pairs += [(f'v2o of {n}', gap, gaps.get(str(n))) for n, gap in second.v2o.items()]
    pairs += [
        (f'v2e of {side}', gap, values['min_v2e_per_edge_m'][side])
        for side, gap in second.v2e.items()
    ]
    least = min((gap for gap in second.v2o.values() if gap is not None), default=None)
    pairs += [('min_v2o_m', least, values['min_v2o_m'])]
    pairs += [('min_v2e_m', min(second.v2e.values()), values['min_v2e_m'])]
    pairs += [('peak_sideslip_deg', second.sideslip, values['peak_sideslip_deg'])]
    if second.left_road:
        pairs += [('beyond_edge_m', second.beyond, values['beyond_edge_m'])]
    for name, own, other in pairs:
        if (own is None) != (other is None) or (
            own is not None and abs(own - other) > NEAR.get(name, NEAREST)
        ):
            yield f'{name} is {other}, the independent evaluation has {own}'
    verdicts = {**values, 'spun': values['lost_how'] == 'spun'}
    for name in VERDICTS:
        own = getattr(second, name)
        if own is not None and verdicts[name] is not own:
            yield f'{name} is {verdicts[name]}, the independent evaluation has {own}'
    spare = [(least, params.safety.obstacle_m), (min(second.v2e.values()), params.safety.edge_m)]
    spare = min(gap - safe for gap, safe in spare if gap is not None)
    if abs(spare) > NEAREST and values['entered_unsafe_area'] is not (spare < 0.0):
        yield f'entered_unsafe_area is {values["entered_unsafe_area"]}, the gap is {spare}'
