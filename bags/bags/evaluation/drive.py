"""One run as arrays in SI units, and what follows from them sample by sample.

drive_from_columns   motion, inputs, ticks, scene, parameters of a run
compute_series       distances and angles: the basis of metrics and figures
candidate_lines ...  what the controller published about its ticks: plans, numbers, answers

Positions are in the frame `map`, velocities and accelerations in `base_link` (ISO 8855).
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from bags.errors import BagError
from bags.evaluation import geometry
from bags.evaluation.geometry import Outline
from bags.storage.columns import Columns
from bags.storage.read import LOCKSTEP
from msgs_yaml import contract
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import Obstacles, Why
from node_runtime import provenance

REQUIRED_TOPICS = (
    *('/scenario/reference', '/scenario/road_edges', '/scenario/obstacles'),
    '/vehicle/odometry',
)
COMMAND, WHY = '/controller/command', '/controller/why'  # absent without any answer
PREDICTION = '/controller/prediction'
FRESH_PLAN = ('solved', 'stopped_early')  # fallback levels (`rung`) that follow a fresh plan
LATERAL_LIMIT = 'plant_lateral_limit_mps2'  # in the run information, where it is known
LONGEST_S = 86_400.0  # of a drive
EMPTY_NS, NEVER = np.empty(0, dtype=np.int64), np.empty(0, dtype=bool)
STATE_STALE = 'state_stale'  # the reason of a command that answers no state
SEARCH_M = 15.0  # how far the projection on the reference may move between two messages
NS = 1e-9  # s
SIDESLIP_FROM = 3.0  # m/s, the sideslip angle of a standing car is undefined


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
    command, why = columns.get(COMMAND), columns.get(WHY)
    if run_info.get('mode') == LOCKSTEP:
        # only a second controller, or a second plant, gives two messages of one stamp
        for topic in {'/vehicle/odometry', COMMAND} & columns.keys():
            stamps, counts = np.unique(columns[topic].stamp_ns, return_counts=True)
            if np.any(counts > 1):
                stamp_s = stamps[np.argmax(counts)] / NS_PER_S
                raise BagError(
                    f'{name}: {topic} has two different messages of one stamp ({stamp_s:.3f} s): '
                    'two controllers or plants shared a ROS domain, so the run cannot be evaluated'
                )
    reference, edges, obstacles, state = (columns[topic] for topic in REQUIRED_TOPICS)
    # absent from a plant that has no such
    actuators, imu = columns.get('/vehicle/actuators'), columns.get('/vehicle/imu')
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
        np.array([rung == FRESH_PLAN[0] for rung in rungs], dtype=bool),
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
        rates_hz = contract.load().topics[COMMAND].rate_hz
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


class CandidateLine(NamedTuple):
    """One plan that was compared."""

    number: int  # 0 is the plan followed before
    name: str  # the initial guess: `left of 1`, `brake`
    points: np.ndarray  # (n, 2) m, map
    is_chosen: bool
    is_clean: bool  # touches nothing and stays on the road


def candidate_lines(why: Mapping[str, float | str]) -> list[CandidateLine]:
    """Return the plans of one tick that have a line; none where a tick compared nothing."""
    lines = []
    for number in range(int(why.get('candidates.count', 0))):
        key = f'candidates.{number}'
        text = why.get(f'{key}.line')
        if isinstance(text, str):
            points = np.array([pair.split(',') for pair in text.split()], float)
            chosen, clean = why.get('candidates.chosen') == number, why.get(f'{key}.clean') == 1
            lines.append(CandidateLine(number, str(why[f'{key}.name']), points, chosen, clean))
    return lines


def report_number(report: Mapping[str, float | str], key: str) -> float:
    """Return a number of one report; not-a-number where the key has none."""
    value = report.get(key)
    return float(value) if isinstance(value, (int, float)) else math.nan


def report_numbers(reports: Iterable[Why], key: str) -> np.ndarray:
    """Return the number (n,) of each report; not-a-number where one has none."""
    return np.array([report_number(why.values, key) for why in reports], dtype=float)


def is_answer(command_ns: np.ndarray, reports: Iterable[Why]) -> np.ndarray:
    """Return for each command stamp (n,) [ns] whether it answers a state.

    Without `reports`, those of the controller, every command counts as an answer.
    """
    stale = [why.stamp_ns for why in reports if why.values.get('reason') == STATE_STALE]
    return ~np.isin(command_ns, stale)


class Series(NamedTuple):
    """One entry per odometry message of the drive."""

    t: np.ndarray  # s, since the first
    station: np.ndarray  # m, along the reference
    contouring: np.ndarray  # m, left of the reference positive
    speed: np.ndarray  # m/s
    sideslip: np.ndarray  # rad, atan2(vy, vx), not-a-number at speeds below SIDESLIP_FROM
    v2o: dict[int, np.ndarray]  # m, per obstacle id, vehicle circle to obstacle; nan while absent
    v2e: dict[str, np.ndarray]  # m, per edge, vehicle circle to edge; negative beyond it
    outline_gaps: dict[int, np.ndarray]  # m, per obstacle id, true outline to it; nan while absent

    def __repr__(self):
        return f'Series({len(self.t)} samples, {len(self.v2o)} obstacles)'


def compute_series(drive: Drive) -> Series:
    """Return the Series of a drive."""
    motion, scene, facts = drive.motion, drive.scene, drive.facts
    points = np.column_stack([motion.x, motion.y])
    projection = geometry.project_drive(points, scene.reference, SEARCH_M)
    circles = circle_centres(motion, facts.circles)

    def nearest(gaps):
        """Return the smallest distance (n,) over the car's circles; `gaps` are of their centres."""
        return np.min(gaps, axis=0) - facts.vehicle_radius

    # of an obstacle of several discs the nearest counts
    pose, v2o, outline_gaps = (motion.x, motion.y, motion.yaw), {}, {}
    for o in scene.obstacles:
        x, y = obstacle_position(o, scene, motion.stamp_ns)
        away = nearest([np.hypot(*(at - np.column_stack([x, y])).T) - o.radius for at in circles])
        gap = geometry.gap_to_circle(*pose, facts.outline, x, y, o.radius)
        v2o[o.id] = np.fmin(v2o.get(o.id, away), away)
        outline_gaps[o.id] = np.fmin(outline_gaps.get(o.id, gap), gap)
    speed = np.hypot(motion.vx, motion.vy)
    sideslip = np.arctan2(motion.vy, motion.vx)
    return Series(
        t=(motion.stamp_ns - motion.stamp_ns[0]) * NS,
        station=projection.distance,
        contouring=projection.offset,
        speed=speed,
        sideslip=np.where(speed > SIDESLIP_FROM, sideslip, np.nan),
        # D_V2O of the paper (eq. 3), and D_V2E (eq. 4) with the sign of the road's side
        v2o=v2o,
        v2e={
            side: nearest([inside * geometry.distance_to_polyline(at, edge) for at in circles])
            for side, inside, edge in (('left', -1.0, scene.left), ('right', 1.0, scene.right))
        },
        outline_gaps=outline_gaps,
    )


def latest_message(scene: Scene, stamp_ns: np.ndarray) -> np.ndarray:
    """Return the index of the latest message of the obstacles at each stamp; 0 before the first."""
    return np.maximum(np.searchsorted(scene.obstacle_stamp_ns, stamp_ns, side='right') - 1, 0)


def obstacle_position(
    obstacle: Obstacle, scene: Scene, stamp_ns: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return x, y [m] at each stamp: the latest message, extrapolated at constant velocity."""
    latest = latest_message(scene, stamp_ns)
    age = (stamp_ns - scene.obstacle_stamp_ns[latest]) * NS
    x = obstacle.x[latest] + obstacle.vx[latest] * age
    return x, obstacle.y[latest] + obstacle.vy[latest] * age


def circle_centres(motion: Motion, circles: Sequence[float]) -> list[np.ndarray]:
    """Return the centres (n, 2) [m, map] of the car's circles, so far ahead of its own centre."""
    cos, sin = np.cos(motion.yaw), np.sin(motion.yaw)
    return [np.column_stack([motion.x + d * cos, motion.y + d * sin]) for d in circles]
