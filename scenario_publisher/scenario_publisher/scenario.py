"""Scenarios: from a name or a file to path, edges, friction, obstacles, start and end of a run."""

import math
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from msgs_yaml import share
from msgs_yaml.strict_yaml import YamlError, closest
from msgs_yaml.types import Obstacles, Reference, RoadEdges
from scenario_publisher import (
    actors,
    build,
    checks,
    document,
    friction,
    line,
    road,
    schema,
    shape,
)
from scenario_publisher.actors import Actor
from scenario_publisher.document import ScenarioError
from scenario_publisher.friction import Patches
from scenario_publisher.line import Line

PACKAGE = 'scenario_publisher'
FOLDER = 'scenarios'
SUFFIX = '.yaml'
# ROS reads stamp 0 as "no time", so every run begins one second later
START_NS = 1_000_000_000


class Start(NamedTuple):
    """Where the car starts and how fast."""

    X: float  # m, map
    Y: float  # m, map
    psi: float  # rad, in [-pi, pi]
    speed: float  # m/s


class Stop(NamedTuple):
    """The finish line, across the path at (X, Y), and the longest a run may take."""

    X: float  # m, map
    Y: float  # m, map
    psi: float  # rad, heading of the path there, in [-pi, pi]
    armed_after: float  # m travelled, before which crossing the line does not count
    time: float  # s


class GivenSpeed(NamedTuple):
    """A speed of the start or of the path, and where the file gives it."""

    key: str  # 'start.speed_mps', 'speed.constant_mps' or 'speed.speeds_mps[<i>]'
    speed: float  # m/s


class Scenario(NamedTuple):
    """A scenario, checked; stamps are those of the start of a lockstep run."""

    name: str
    description: str
    reference: Reference
    edges: RoadEdges
    obstacles: Obstacles  # at the start
    friction: float  # scale of the grip of the road, 1 is dry
    start: Start
    stop: Stop
    text: str  # the YAML it was made from
    actors: tuple[Actor, ...]  # obstacles over time
    patches: Patches = Patches()  # where the friction is another
    speeds: tuple[GivenSpeed, ...] = ()  # the start's, if it is given, then the desired ones


def available() -> tuple[str, ...]:
    """Return the names of the scenarios that come with the package."""
    folder = share.path(PACKAGE, FOLDER)
    return tuple(sorted(path.stem for path in folder.glob(f'*{SUFFIX}')))


def load(name_or_path: str | os.PathLike) -> Scenario:
    """Return a scenario by its name, or from a file when given a path or a name ending in .yaml.

    Raises ScenarioError that names file, line, key and what is allowed, or, when there is no such
    scenario, those that exist.
    """
    path = _find(os.fspath(name_or_path))
    return parse(document.read(path), str(path))


def parse(text: str, source: str) -> Scenario:
    """Return the scenario of a YAML text; `source` is the file name that errors show."""
    root = document.parse(text, source)
    try:
        given = build.value(schema.File, root)
    except YamlError as error:
        raise ScenarioError(str(error)) from None
    return _make(given, text, lambda key, what: document.error_at(root, key, what))


def obstacles_at(scn: Scenario, t: float, stamp_ns: int) -> Obstacles:
    """Return the obstacles that are there t [s] after the start, moved, under a stamp."""
    t = max(t, 0.0)
    there = (actors.moved(actor, t) for actor in scn.actors if actors.is_there(actor, t))
    return Obstacles(stamp_ns, tuple(there))


def _find(wanted):
    is_path = '/' in wanted or os.sep in wanted or wanted.endswith(SUFFIX)
    if is_path:
        # not Path.expanduser, which raises for an unknown user
        path = Path(os.path.expanduser(wanted))
        if path.is_file():
            return path
    elif wanted in available():
        return share.path(PACKAGE, FOLDER, wanted + SUFFIX)
    what = 'no file' if is_path else 'no scenario'
    hint = closest(Path(wanted).stem, available())
    raise ScenarioError(f'{what} {wanted!r}; available: {", ".join(available())}{hint}')


def _make(given, text, fail):
    where = road.make(given.road, given.sampling.edges_m, fail)
    path = shape.make_line(given.path, 'path', given.sampling.path_m, fail)
    checks.path_stays_on_road(path, where, given.sampling.edges_m, fail)
    speed = _speed_table(given.speed, fail)
    crowd = _place(given.obstacles, where.centre, fail)
    checks.obstacles_touch_road(crowd, where, given.stop.time_s, fail)
    start = _start(given.start, path, speed, fail)
    checks.stop_is_ahead(path, given.stop, start, fail)
    checks.start_is_free(start, where, crowd, given.sampling.edges_m, fail)
    made = Scenario(
        name=given.name,
        description=given.description,
        reference=Reference(START_NS, path.X, path.Y, path.psi, shape.travel_times(path, speed)),
        edges=RoadEdges(START_NS, where.left, where.right),
        obstacles=Obstacles(START_NS, ()),
        friction=given.friction,
        start=start,
        stop=_stop(given.stop, path, start),
        text=text,
        actors=crowd,
        patches=friction.make(given.friction_patches, where.centre, fail),
        speeds=_given_speeds(given),
    )
    return made._replace(obstacles=obstacles_at(made, 0.0, START_NS))


def _given_speeds(given):
    start = given.start.speed_mps
    found = [] if start is None else [GivenSpeed('start.speed_mps', start)]
    if isinstance(given.speed, schema.ConstantSpeed):
        return (*found, GivenSpeed('speed.constant_mps', given.speed.constant_mps))
    listed = enumerate(given.speed.speeds_mps)
    return (*found, *(GivenSpeed(f'speed.speeds_mps[{i}]', speed) for i, speed in listed))


def _speed_table(given, fail):
    if isinstance(given, schema.ConstantSpeed):
        return np.array([[0.0, given.constant_mps]])
    return shape.make_table(given.stations_m, given.speeds_mps, 'speed', 'speeds_mps', fail)


def _place(obstacles, centre, fail):
    if len(obstacles) > checks.MAX_OBSTACLES:
        what = f'has {len(obstacles)} obstacles; allowed at most {checks.MAX_OBSTACLES}'
        raise fail('obstacles', what)
    for i, given in enumerate(obstacles):
        if isinstance(given, schema.RoadObstacle) and given.station_m > centre.s[-1]:
            what = f'lies beyond the road with {given.station_m:g}'
            raise fail(f'obstacles[{i}].station_m', f'{what}; allowed 0 to {centre.s[-1]:.2f} m')
    return tuple(actors.place(i + 1, given, centre) for i, given in enumerate(obstacles))


def _start(given, path, speed, fail):
    if isinstance(given, schema.StartPose):
        return Start(given.x_m, given.y_m, _wrapped(given.yaw_rad), given.speed_mps)
    if given.progress_m > path.s[-1]:
        what = f'is {given.progress_m:g} m, beyond the end of the path'
        raise fail('start.progress_m', f'{what}; allowed 0 to {path.s[-1]:.2f} m')
    X, Y, psi = map(float, line.at(path, given.progress_m))
    wanted = float(np.interp(given.progress_m, *speed.T))
    return Start(X, Y, _wrapped(psi), wanted if given.speed_mps is None else given.speed_mps)


def _stop(given, path: Line, start: Start):
    X, Y, psi = map(float, line.at(path, given.progress_m))
    begin = float(path.s[line.nearest(path, start.X, start.Y)])
    ahead = np.cos(psi) * (path.X - X) + np.sin(psi) * (path.Y - Y)
    crossing = np.sign(ahead[:-1]) != np.sign(ahead[1:])
    between = (path.s[:-1] > begin) & (path.s[1:] < given.progress_m)
    # a lap passes the line before: it counts from half way since the last time
    last = float(path.s[1:][crossing & between].max(initial=begin))
    armed_after = (last + given.progress_m) / 2 - begin
    return Stop(X, Y, _wrapped(psi), armed_after, given.time_s)


def _wrapped(psi):
    """Return the same heading in [-pi, pi]."""
    return math.remainder(psi, math.tau)
