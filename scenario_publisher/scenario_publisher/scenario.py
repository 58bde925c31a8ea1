"""Scenarios: path, edges, friction, obstacles, start and end of a run from a name or a file."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from math import remainder, tau
from pathlib import Path
from typing import NamedTuple

import numpy as np

from msgs_yaml import conversions, missing_file, share, strict_yaml
from msgs_yaml.missing_file import YAML_SUFFIXES
from msgs_yaml.strict_yaml import Struct, YamlError, closest
from msgs_yaml.types import Branch, Obstacles, Predictions, Reference, RoadEdges
from scenario_publisher import actors, lines, plausibility, road_geometry, schema, sight
from scenario_publisher.actors import Actor
from scenario_publisher.expectations import NOTHING_EXPECTED, Expectations
from scenario_publisher.friction_patches import Patches, build_patches
from scenario_publisher.lines import Line
from scenario_publisher.polyline import running_sum
from scenario_publisher.schema import KeyedError, ScenarioError
from scenario_publisher.sight import Sight

PACKAGE = 'scenario_publisher'
FOLDER = 'scenarios'
SUFFIX = '.yaml'
MAX_BYTES = 8_000_000  # of a file
# ROS reads stamp 0 as "no time", so every run begins one second later
START_NS = 1_000_000_000
# what a scenario is refused for, in this order
CHECKS = (
    'every key is known, given once, of its type and within its range',
    'the edges of the road neither cross nor fold back',
    'the path has no jumps and lies on the road',
    'the stations of the desired speed increase',
    'every obstacle is on the road at some time of the run',
    'start and finish line lie on the path, the finish ahead of the start',
    'the start is on the road, along the path and free of obstacles',
    'friction patches lie on the road',
)
KEYS, ROAD, PATH, SPEED, OBSTACLES, FINISH, START, PATCHES = CHECKS
AHEAD = np.arange(0.0, 5.01, 0.125)  # s of an exact prediction; numbers of 32 bits hold them


class NodeParams(Struct):
    """Parameters of scenario_node besides `mode`."""

    scenario: str


class Start(NamedTuple):
    """Initial pose and velocity of the car."""

    X: float  # m, map
    Y: float  # m, map
    psi: float  # rad, in [-pi, pi]
    speed: float  # m/s, forwards
    vy: float = 0.0  # m/s, to the left
    r: float = 0.0  # rad/s


class Stop(NamedTuple):
    """The finish line, across the path at (X, Y), and the time limit of a run."""

    X: float  # m, map
    Y: float  # m, map
    psi: float  # rad, heading of the path there, in [-pi, pi]
    armed_after: float  # m travelled, before which crossing the line does not count
    time: float  # s
    standstill: float | None = None  # s that the car may stand once it has moved, None: 1 s


class Scenario(NamedTuple):
    """A checked scenario; stamps are those of the start of a lockstep run."""

    name: str
    description: str
    reference: Reference
    edges: RoadEdges
    obstacles: Obstacles  # at the start
    friction: float  # scale of the grip of the road, 1 is dry
    start: Start
    stop: Stop
    text: str  # its YAML
    actors: tuple[Actor, ...]  # obstacles over time
    patches: Patches = Patches()  # areas of another friction
    # key in the file, as 'start.speed_mps' or 'speed.speeds_mps[<i>]', and speed [m/s]: that of the
    # start, if given, then the desired ones
    speeds: tuple[tuple[str, float], ...] = ()
    expect: Expectations = NOTHING_EXPECTED  # of a run
    sight: Sight | None = None  # None: everything is seen
    predicts: bool = False  # whether where the obstacles will be is published, too

    def __repr__(self) -> str:
        return f'Scenario({self.name!r}, {len(self.reference.X)} poses, {len(self.actors)} actors)'


def available() -> tuple[str, ...]:
    """Return the names of the scenarios that come with the package."""
    folder = share.path(PACKAGE, FOLDER)
    return tuple(sorted(path.stem for path in folder.glob(f'*{SUFFIX}')))


def load(name_or_path: str | os.PathLike) -> Scenario:
    """Return a scenario by its name, or from a file when given a path or a name ending in .yaml.

    Raises ScenarioError that names file, line, key and allowed values, or, for an unknown name or
    file, the available scenarios or files.
    """
    path = _find(os.fspath(name_or_path))
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise ScenarioError(f'{path}: has {size} bytes; allowed at most {MAX_BYTES} bytes')
        text = path.read_text(encoding='utf-8')
    except OSError as error:
        raise ScenarioError(f'{path}: {error.strerror or error}') from None
    except UnicodeDecodeError as error:
        raise ScenarioError(f'{path}: is no UTF-8 text: {error.reason}') from None
    return parse(text, str(path))


def parse(text: str, source: str) -> Scenario:
    """Return the scenario of a YAML text; `source` is the file name that errors show."""
    check = ''
    try:
        root = strict_yaml.parse(text, source)
        check = KEYS
        return _build(strict_yaml.parse_value(schema.File, root), text)
    except KeyedError as error:
        refused, check = root.error_at(*error.args), error.check
    except YamlError as error:
        refused = error
    wrong = ScenarioError(str(refused))
    wrong.check = check
    raise wrong


@contextmanager
def _checking(check: str) -> Iterator[None]:
    """Note in a KeyedError of the `with` block which of CHECKS does not hold."""
    try:
        yield
    except KeyedError as error:
        error.check = check
        raise


def describe_namesake(name_or_path: str, scn: Scenario) -> str:
    """Return which of two scenarios of one name is used, '' where there is no other.

    They are a file of the user and one that comes with the package; equal texts are one scenario.
    """
    names = available()
    if _is_path(name_or_path):
        if scn.name not in names or _shipped(scn.name).read_text() == scn.text:
            return ''
        return (
            f'{name_or_path} has the name of a scenario that comes with the package, {scn.name}: '
            'the file is used; give it a `name:` of its own, or runs of both share a folder'
        )
    mine = next(
        (Path(name_or_path + end) for end in YAML_SUFFIXES if os.path.isfile(name_or_path + end)),
        None,
    )
    if mine is None or (os.access(mine, os.R_OK) and mine.read_text(errors='replace') == scn.text):
        return ''
    return (
        f'{name_or_path} is the scenario that comes with the package, not the file {mine} in this '
        f'folder: for that one give ./{mine}'
    )


def obstacles_at(
    scn: Scenario, t: float, stamp_ns: int, car: tuple[float, float] | None = None
) -> Obstacles:
    """Return the obstacles present t [s] after the start, at their positions, under a stamp.

    Those that a car at (X, Y) [m] sees, without one all.
    """
    t = max(t, 0.0)
    present = (actors.obstacle_at(actor, t) for actor in scn.actors if actors.is_present(actor, t))
    items = (
        tuple(present) if scn.sight is None or car is None else sight.seen(scn.sight, car, present)
    )
    return Obstacles(stamp_ns, items)


def predictions_at(scn: Scenario, t: float, obstacles: Obstacles) -> Predictions:
    """Return where obstacles of t [s] after the start will be while they are there, exactly.

    As they are received: rounded to numbers of 32 bits, 1 mm within 10 km of the origin.
    """
    t, stamp_ns, by_id = max(t, 0.0), obstacles.stamp_ns, {}
    seen = {o.id for o in obstacles.items}
    for actor in scn.actors:
        if actor.obstacle.id in seen:
            ahead = AHEAD[t + AHEAD < actor.disappears]
            covariance = np.zeros((len(ahead), 2, 2))
            XY = actors.expected(actor, t, ahead)
            by_id[actor.obstacle.id] = (Branch(stamp_ns, 1.0, ahead, *XY, covariance),)
    return conversions.predictions_as_received(Predictions(stamp_ns, by_id))


def _shipped(name):
    return share.path(PACKAGE, FOLDER, name + SUFFIX)


def _is_path(name_or_path):
    return '/' in name_or_path or os.sep in name_or_path or name_or_path.endswith(YAML_SUFFIXES)


def _find(name_or_path):
    is_path = _is_path(name_or_path)
    if is_path:
        # not Path.expanduser, which raises for an unknown user
        path = Path(os.path.expanduser(name_or_path))
        if os.path.isfile(path):  # false of a name that is too long, too
            return path
    elif name_or_path in available():
        return _shipped(name_or_path)
    hint = closest(Path(name_or_path).stem, available())
    if is_path:
        there = missing_file.describe_neighbours(name_or_path, 'YAML file', missing_file.is_yaml)
        # of a file that is there rather than of one that comes with the package
        own = '' if 'did you mean' in there or not hint else f'{hint} (without path and {SUFFIX})'
        raise ScenarioError(f'no file {name_or_path!r}: {there}{own}')
    here = missing_file.describe_yaml_here(name_or_path)
    if here:
        raise ScenarioError(f'no scenario {name_or_path!r} comes with the package; {here}')
    names = ', '.join(available())
    raise ScenarioError(f'no scenario {name_or_path!r}; available: {names}, or a file{hint}')


def _build(file, text):
    with _checking(ROAD):
        road = road_geometry.build_road(file.road, file.sampling.edges_m)
    with _checking(PATH):
        path = road_geometry.sample_line(file.path, 'path', file.sampling.path_m)
        plausibility.check_path_on_road(path, road, file.sampling.edges_m)
    given = [] if file.start.speed_mps is None else [('start.speed_mps', file.start.speed_mps)]
    with _checking(SPEED):
        if isinstance(file.speed, schema.ConstantSpeed):
            given.append(('speed.constant_mps', file.speed.constant_mps))
            speed = np.array([[0.0, file.speed.constant_mps]])
        else:
            rows = file.speed.stations_m, file.speed.speeds_mps
            given += [(f'speed.speeds_mps[{i}]', mps) for i, mps in enumerate(rows[1])]
            speed = road_geometry.build_table(*rows, 'speed', 'speeds_mps')
        view = sight.build(file.sight, path)
    with _checking(OBSTACLES):
        crowd = actors.place_actors(file.obstacles, road.centre)
        plausibility.check_obstacles_touch_road(crowd, road, file.stop.time_s)
    speed = speed if view is None else sight.bound_speed(view, speed, crowd)
    with _checking(FINISH):
        start = _start(file.start, path, speed)
        plausibility.check_stop_is_ahead(path, file.stop, start)
    with _checking(START):
        plausibility.check_start_along_path(start, path)
        plausibility.check_start_is_free(start, road, crowd, file.sampling.edges_m)
    with _checking(PATCHES):
        patches = build_patches(file.friction_patches, road.centre)
    # at the desired speed; between two samples it is that desired in the middle
    middle = (path.s[:-1] + path.s[1:]) / 2
    t = running_sum(np.diff(path.s) / np.interp(middle, *speed.T))
    scn = Scenario(
        name=file.name,
        description=file.description,
        reference=Reference(START_NS, path.X, path.Y, path.psi, t),
        edges=RoadEdges(START_NS, road.left, road.right),
        obstacles=Obstacles(START_NS, ()),
        friction=file.friction,
        start=start,
        stop=_stop(file.stop, path, start),
        text=text,
        actors=crowd,
        patches=patches,
        speeds=tuple(given),
        expect=file.expect,
        sight=view,
        predicts=file.predictions == 'exact',
    )
    return scn._replace(obstacles=obstacles_at(scn, 0.0, START_NS, start[:2]))


def _start(block, path, speed):
    sliding = block.lateral_mps, block.yaw_rate_radps
    if isinstance(block, schema.StartPose):
        heading = remainder(block.yaw_rad, tau)
        return Start(block.x_m, block.y_m, heading, block.speed_mps, *sliding)
    if block.progress_m > path.s[-1]:
        what = f'is {block.progress_m:g} m, beyond the end of the path'
        raise KeyedError('start.progress_m', f'{what}; allowed 0 to {path.s[-1]:.2f} m')
    X, Y, psi = map(float, lines.pose_at(path, block.progress_m))
    desired = float(np.interp(block.progress_m, *speed.T))
    speed = desired if block.speed_mps is None else block.speed_mps
    return Start(X, Y, remainder(psi, tau), speed, *sliding)


def _stop(block, path: Line, start: Start):
    X, Y, psi = map(float, lines.pose_at(path, block.progress_m))
    begin = float(path.s[lines.nearest_sample(path, start.X, start.Y)])
    ahead = np.cos(psi) * (path.X - X) + np.sin(psi) * (path.Y - Y)
    crossing = np.sign(ahead[:-1]) != np.sign(ahead[1:])
    between = (path.s[:-1] > begin) & (path.s[1:] < block.progress_m)
    # laps cross the line before: it counts from half way after the last crossing
    last = float(path.s[1:][crossing & between].max(initial=begin))
    armed_after = (last + block.progress_m) / 2 - begin
    return Stop(X, Y, remainder(psi, tau), armed_after, block.time_s, block.standstill_s)
