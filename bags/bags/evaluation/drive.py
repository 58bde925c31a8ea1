"""One run as arrays in SI units: `drive_from_columns(columns, ...)`.

Positions are in the frame `map`, velocities and accelerations in `base_link` (ISO 8855).
"""

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bags.errors import BagError
from bags.evaluation.controller_log import is_answer, report_numbers
from bags.evaluation.geometry import Outline
from bags.storage.columns import Columns
from bags.storage.read import LOCKSTEP
from msgs_yaml import contract
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Obstacles
from node_runtime import provenance

REQUIRED_TOPICS = (
    *('/scenario/reference', '/scenario/road_edges', '/scenario/obstacles'),
    '/vehicle/odometry',
)
MEASURED_TOPICS = ('/vehicle/actuators', '/vehicle/imu')  # absent from a plant that has no such
CONTROLLER_TOPICS = ('/controller/command', '/controller/why')  # absent without any answer
FRESH_PLAN = ('solved', 'stopped_early')  # fallback levels (`rung`) that follow a fresh plan
CONVERGED_PLAN = FRESH_PLAN[0]
LATERAL_LIMIT = 'plant_lateral_limit_mps2'  # in the run information, where it is known
LONGEST_S = 86_400.0  # of a drive
EMPTY_NS, NEVER = np.empty(0, dtype=np.int64), np.empty(0, dtype=bool)


class Motion(NamedTuple):
    """The centre of gravity, one entry per odometry message."""

    stamp_ns: np.ndarray
    x: np.ndarray  # m
    y: np.ndarray  # m
    yaw: np.ndarray  # rad
    vx: np.ndarray  # m/s
    vy: np.ndarray  # m/s


class Accelerations(NamedTuple):
    """Measurements of the inertial unit at the centre of gravity."""

    stamp_ns: np.ndarray
    ax: np.ndarray  # m/s^2
    ay: np.ndarray  # m/s^2


class Inputs(NamedTuple):
    """Positions and forces of the actuators."""

    stamp_ns: np.ndarray
    steer: np.ndarray  # rad, at the road wheels
    force: np.ndarray  # N, both axles, braking negative


class Ticks(NamedTuple):
    """Reports of the controller about each of its steps, and the states it answered."""

    answered_ns: np.ndarray  # stamps of the commands
    solve_ms: np.ndarray  # wall time, ms, one per /controller/why
    solve_cpu_ms: np.ndarray  # processor time likewise; not-a-number in older bags
    fallback: np.ndarray  # whether the step followed no fresh plan, one per /controller/why
    last_reason: str = ''  # why the last step followed no fresh plan; '' when it did
    stamp_ns: np.ndarray = EMPTY_NS  # of the states that the reports are about
    converged: np.ndarray = NEVER  # whether the step followed a plan that converged, likewise


NO_ACCELERATIONS = Accelerations(EMPTY_NS, np.empty(0), np.empty(0))
NO_INPUTS = Inputs(EMPTY_NS, np.empty(0), np.empty(0))


class Obstacle(NamedTuple):
    """One disc of an obstacle over time; not-a-number where a message does not contain it."""

    id: int
    x: np.ndarray  # m, one entry per obstacle message
    y: np.ndarray  # m
    vx: np.ndarray  # m/s
    vy: np.ndarray  # m/s
    radius: float  # m
    disc: int = 0  # which one of the obstacle of this id, that of the message first


class Scene(NamedTuple):
    """The road and the discs of the obstacles, as the scenario published them."""

    reference: np.ndarray  # (n, 2) m, the coarse path
    left: np.ndarray  # (n, 2) m, left road edge in driving order
    right: np.ndarray  # (m, 2) m
    obstacle_stamp_ns: np.ndarray  # one entry per obstacle message
    obstacles: tuple[Obstacle, ...]
    desired_mps: float | None = None  # m/s, mean desired speed of the path; None without stamps


class Facts(NamedTuple):
    """Parameters of the nodes of that run which the evaluation needs."""

    scenario: str
    controller: str
    outline: Outline
    circles: tuple[float, ...]  # m, vehicle circle centres ahead of the centre of gravity
    vehicle_radius: float  # m
    safe_obstacle: float  # m, D_sft,O
    safe_edge: float  # m, D_sft,E
    # of sliding tyres on this road, by the car file of the controller: mean of front and rear
    friction: float
    tick_ns: int  # controller period
    stop: tuple[float, float]  # m, a point of the finish line
    armed_after: float  # m, travelled before the finish line counts
    least_speed: float | None = None  # m/s, below which the controller only brakes
    # m, x and y of each wheel from the centre of gravity; empty where the tracks are unknown
    wheels: tuple[tuple[float, float], ...] = ()
    lateral_limit: float | None = None  # m/s^2, what the plant holds in a steady turn


class Drive(NamedTuple):
    """One run."""

    motion: Motion
    accelerations: Accelerations
    inputs: Inputs
    ticks: Ticks
    scene: Scene
    facts: Facts

    def __repr__(self):
        facts, motion = self.facts, self.motion
        return f'Drive({facts.scenario} by {facts.controller}, {len(motion.x)} states)'


def drive_from_columns(
    columns: Mapping[str, Columns], run_info: Mapping[str, str], name: str
) -> Drive:
    """Return the drive in the columns of a run; `name` is the run's name in errors.

    Without /vehicle/imu there are no accelerations, without /vehicle/actuators no inputs. Raises
    BagError in lockstep when two controllers answered, and for missing parameters.
    """
    command, why = (columns.get(topic) for topic in CONTROLLER_TOPICS)
    if run_info.get('mode') == LOCKSTEP:
        # only a second controller, or a second plant, gives two messages of one stamp
        for topic in {'/vehicle/odometry', CONTROLLER_TOPICS[0]} & columns.keys():
            stamps, counts = np.unique(columns[topic].stamp_ns, return_counts=True)
            if np.any(counts > 1):
                stamp_s = stamps[np.argmax(counts)] / NS_PER_S
                raise BagError(
                    f'{name}: {topic} has two different messages of one stamp ({stamp_s:.3f} s): '
                    'two controllers or plants shared a ROS domain, so the run cannot be evaluated'
                )
    reference, edges, obstacles, state = (columns[topic] for topic in REQUIRED_TOPICS)
    actuators, imu = (columns.get(topic) for topic in MEASURED_TOPICS)
    accelerations, inputs, answered = NO_ACCELERATIONS, NO_INPUTS, EMPTY_NS
    reports = why.values if why else ()
    if imu:
        accelerations = Accelerations(imu.stamp_ns, imu.ax_mps2, imu.ay_mps2)
    if actuators:
        force = actuators.front_x_n + actuators.rear_x_n
        inputs = Inputs(actuators.stamp_ns, actuators.steer_rad, force)
    if command:
        answered = command.stamp_ns[is_answer(command.stamp_ns, reports)]
    rungs = [report.values.get('rung') for report in reports]
    ticks = Ticks(
        answered,
        report_numbers(reports, 'time.solve_ms'),
        report_numbers(reports, 'time.solve_cpu_ms'),
        np.array([rung not in FRESH_PLAN for rung in rungs], dtype=bool),
        '' if not rungs or rungs[-1] in FRESH_PLAN else str(reports[-1].values.get('reason', '')),
        why.stamp_ns if why else EMPTY_NS,
        np.array([rung == CONVERGED_PLAN for rung in rungs], dtype=bool),
    )
    return Drive(
        Motion(state.stamp_ns, state.x_m, state.y_m, state.yaw_rad, state.vx_mps, state.vy_mps),
        accelerations,
        inputs,
        ticks,
        _scene(reference.values[-1], edges.values[-1], obstacles),
        facts_from_run_info(run_info, name),
    )


def _scene(reference, edges, obstacles):
    # length over duration; none of a path whose poses have no times
    duration = reference.t[-1] - reference.t[0]
    length = np.hypot(np.diff(reference.X), np.diff(reference.Y)).sum()
    has_times = math.isfinite(duration) and duration > 0.0
    stamp_ns = np.maximum.accumulate(obstacles.stamp_ns)  # an array without markers has no stamp
    return Scene(
        _polyline('/scenario/reference', np.column_stack([reference.X, reference.Y])),
        _polyline('/scenario/road_edges', edges.left),
        _polyline('/scenario/road_edges', edges.right),
        stamp_ns,
        obstacle_tracks(stamp_ns, obstacles.values),
        float(length / duration) if has_times else None,
    )


def obstacle_tracks(stamp_ns: np.ndarray, messages: Sequence[Obstacles]) -> tuple[Obstacle, ...]:
    """Return the discs of the obstacles of messages and their stamps (n,), ordered by id.

    A message has the velocity of the first disc of an object. The others move with it, and as
    from this message to the next relative to it: a truck in a bend turns.
    """
    # x, y, vx, vy of each disc, a row per message; and the last radius
    rows: dict[tuple[int, int], np.ndarray] = {}
    radii: dict[int, float] = {}
    for row, message in enumerate(messages):
        for item in message.items:
            for k, o in enumerate(item.discs()):
                track = rows.setdefault((item.id, k), np.full((len(messages), 4), np.nan))
                track[row], radii[item.id] = (o.X, o.Y, o.vX, o.vY), item.r_obs
    for number, k in rows:
        if k:
            offset = rows[number, k][:, :2] - rows[number, 0][:, :2]
            with np.errstate(divide='ignore', invalid='ignore'):
                turning = np.diff(offset, axis=0) / np.diff(stamp_ns)[:, None] * NS_PER_S
            rows[number, k][:-1, 2:] += np.where(np.isfinite(turning), turning, 0.0)
    return tuple(Obstacle(n, *rows[n, k].T, radii[n], k) for n, k in sorted(rows))


def _polyline(topic, points):
    """Return a polyline without points that repeat the one before."""
    moves = np.any(np.diff(points, axis=0, prepend=np.nan) != 0.0, axis=1)
    if np.count_nonzero(moves) < 2:
        raise BagError(f'{topic}: all points of the line are the same')
    return points[moves]


def facts_from_run_info(run_info: Mapping[str, str], name: str) -> Facts:
    """Return the parameters for the evaluation; BagError names the first that is missing."""
    text = run_info.get(LATERAL_LIMIT)
    try:
        limit = None if text is None else float(text)
    except ValueError:
        limit = math.nan
    if limit is not None and not 0 < limit < math.inf:
        raise BagError(f'{name}: {LATERAL_LIMIT} is {text!r}; allowed are numbers above 0')
    try:
        parameters = json.loads(run_info['parameters'])
        controller, plant = parameters['controller'], parameters['plant']
        tyres = (controller['tyre.front_friction'], controller['tyre.rear_friction'])
        outline = outline_of(plant)
        radius, circles = circles_of(controller, outline)
        return Facts(
            scenario=run_info['scenario'],
            controller=provenance.run_name(run_info),
            outline=outline,
            circles=circles,
            vehicle_radius=radius,
            safe_obstacle=controller['safety.obstacle_m'],
            safe_edge=controller['safety.edge_m'],
            friction=plant['friction'] * sum(tyres) / len(tyres),
            tick_ns=tick_period_ns(run_info),
            stop=(plant['stop.x_m'], plant['stop.y_m']),
            armed_after=plant['stop.armed_after_m'],
            least_speed=controller.get('limits.least_speed_mps'),
            wheels=_wheels(plant),
            lateral_limit=limit,
        )
    except KeyError as missing:
        raise BagError(
            f'{name}: the run does not say {missing}; was it recorded by hand?'
        ) from None


def outline_of(plant: Mapping[str, Any]) -> Outline:
    """Return the outline from the parameters of the plant; KeyError if one is missing."""
    return Outline(
        front=plant['car.body.cog_to_front_m'] + plant['car.outline.front_overhang_m'],
        rear=plant['car.body.cog_to_rear_m'] + plant['car.outline.rear_overhang_m'],
        width=plant['car.outline.width_m'],
    )


def circles_of(controller: Mapping[str, Any], outline: Outline) -> tuple[float, tuple[float, ...]]:
    """Return the radius [m] of the controller's vehicle circles, and their offsets [m].

    With `body.circles` they are as many as that and cover the outline, each an equal share of its
    length; else they are those that the parameters list. KeyError if one is missing.
    """
    count = controller.get('body.circles')
    if not count:
        return controller['body.circle_radius_m'], tuple(controller['body.circle_offsets_m'])
    share = (outline.front + outline.rear) / count
    offsets = tuple((k + 0.5) * share - outline.rear for k in range(count))
    return math.hypot(share / 2, outline.width / 2), offsets


def tick_period_ns(run_info: Mapping[str, str]) -> int:
    """Return the period of the controller [ns]: recorded, else that of the contract.

    `run_info` is as `provenance.describe_run` has it, or empty.
    """
    parameters = json.loads(run_info.get('parameters', '{}'))
    step_s = parameters.get('controller', {}).get('model.step_s')
    if step_s is None:
        rates_hz = contract.load().topics[CONTROLLER_TOPICS[0]].rate_hz
        step_s = 1.0 / rates_hz[run_info.get('mode', LOCKSTEP)]
    return round(step_s * NS_PER_S)


def _wheels(plant):
    """Return x, y [m] of each wheel from the centre of gravity, nothing where they are unknown."""
    axles = (('front', 1.0), ('rear', -1.0))
    tracks = [plant.get(f'car.suspension.{axle}.track_m') for axle, _ in axles]
    if None in tracks:
        return ()
    return tuple(
        (sign * plant[f'car.body.cog_to_{axle}_m'], side * track / 2)
        for (axle, sign), track in zip(axles, tracks)
        for side in (1.0, -1.0)
    )


def drop_nonfinite(drive: Drive) -> Drive:
    """Return a drive without the samples of car, accelerations and inputs that are not finite.

    Raises BagError when no state of the car is left, and for samples more than LONGEST_S apart:
    metrics that sample every 10 ms take memory for all of that time.
    """
    name, sampled = drive.facts.controller, {}
    for part in ('motion', 'accelerations', 'inputs'):
        columns = getattr(drive, part)
        kept = np.all([np.isfinite(column) for column in columns], axis=0)
        if not kept.all():
            columns = type(columns)(*(column[kept] for column in columns))
        sampled[part] = columns
        span_s = int(np.ptp(columns.stamp_ns)) / NS_PER_S if columns.stamp_ns.size else 0.0
        if part == 'motion' and not columns.stamp_ns.size:
            raise BagError(f'{name}: no state of the car is finite')
        if span_s > LONGEST_S:
            raise BagError(
                f'{name}: the stamps of the car span {span_s:.0f} s; '
                f'allowed up to {LONGEST_S:.0f} s'
            )
    return drive._replace(**sampled)
