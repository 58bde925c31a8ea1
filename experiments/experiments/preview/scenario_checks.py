"""What a scenario holds, what is checked, and how close the coarse path comes to everything."""

from typing import NamedTuple

import numpy as np
from rich.console import Console

from bags.command_line import print_text
from mpcc_controller.parameters import ControllerParams
from scenario_publisher import actors, advice, polyline
from scenario_publisher.actors import Actor
from scenario_publisher.polyline import running_sum, steps
from scenario_publisher.scenario import Scenario

GRAVITY = 9.81  # m/s^2
KPH = 3.6  # km/h per m/s
STEP_S = 0.01


class Circles(NamedTuple):
    """What a controller keeps between its car and the surroundings."""

    horizon_s: float  # how far ahead it plans
    radius_m: float  # of the circle of the car
    obstacle_m: float  # safety distance to obstacles
    edge_m: float  # to road edges


class PathProfile(NamedTuple):
    """The coarse path, sample by sample, (n,) each."""

    station: np.ndarray  # m
    speed: np.ndarray  # m/s, desired
    lateral: np.ndarray  # m/s^2, of the desired speed on the path, to the left positive
    to_edge: np.ndarray  # m, from the circle of a car on the path to the nearer edge


class Encounter(NamedTuple):
    """How close a car that follows the path at the desired speed comes to an obstacle."""

    number: int
    gap_m: float  # between the circles; negative: they overlap
    t: float  # s after the start
    station: float  # m


def circles_of(params: ControllerParams) -> Circles:
    """Return the distances of a controller."""
    return Circles(
        params.model.horizon * params.model.step_s,
        params.body.circle_radius_m,
        params.safety.obstacle_m,
        params.safety.edge_m,
    )


def profile(scn: Scenario, circles: Circles) -> PathProfile:
    """Return the coarse path with what it asks for."""
    ref = scn.reference
    station = running_sum(steps(np.column_stack([ref.X, ref.Y])))
    speed = np.interp(station, (station[1:] + station[:-1]) / 2, np.diff(station) / np.diff(ref.t))
    curvature = np.gradient(ref.psi, station)
    inside = np.minimum(
        -polyline.left_of(scn.edges.left, ref.X, ref.Y),
        polyline.left_of(scn.edges.right, ref.X, ref.Y),
    )
    return PathProfile(station, speed, curvature * speed**2, inside - circles.radius_m)


def encounter(scn: Scenario, actor: Actor, path: PathProfile, circles: Circles) -> Encounter | None:
    """Return where a car that follows the path comes closest to an obstacle, None if it is gone."""
    ref = scn.reference
    # the car starts at its place on the path, not at the first pose
    first = int(np.argmin(np.hypot(ref.X - scn.start.X, ref.Y - scn.start.Y)))
    end = min(scn.stop.time, ref.t[-1] - ref.t[first])
    times = [t for t in np.arange(0.0, end, STEP_S) if actors.is_present(actor, t)]
    if not times:
        return None
    places = [actors.obstacle_at(actor, t) for t in times]
    along = ref.t[first] + np.array(times)
    X, Y = np.interp(along, ref.t, ref.X), np.interp(along, ref.t, ref.Y)
    apart = np.hypot(X - [o.X for o in places], Y - [o.Y for o in places])
    i = int(np.argmin(apart))
    gap = float(apart[i]) - actor.obstacle.r_obs - circles.radius_m
    station = float(np.interp(along[i], ref.t, path.station))
    return Encounter(actor.obstacle.id, gap, float(times[i]), station)


def show(scn: Scenario, circles: Circles, console: Console) -> list[str]:
    """Print the summary; return the advice that was printed."""
    path = profile(scn, circles)
    finish = advice.finish_station(scn)
    slow, fast = path.speed.min(), path.speed.max()
    lateral = float(np.abs(path.lateral).max())
    at = float(path.station[np.argmax(np.abs(path.lateral))])
    where = float(path.station[np.argmin(path.to_edge)])
    lines = {
        'scenario': f'{scn.name}: {scn.description}',
        'path': f'{path.station[-1]:.1f} m, finish line at {finish:.1f} m or {scn.stop.time:g} s',
        'desired speed': f'{slow:.1f} m/s ({slow * KPH:.0f} km/h)'
        if fast - slow < 0.05
        else f'{slow:.1f} to {fast:.1f} m/s ({slow * KPH:.0f} to {fast * KPH:.0f} km/h)',
        'start': f'({scn.start.X:.1f}, {scn.start.Y:.1f}) m, {scn.start.speed:.1f} m/s',
        'friction': f'{scn.friction:g}'
        + (f', and {len(scn.patches.friction)} patches' if scn.patches.friction else ''),
        'path asks for': f'up to {lateral:.1f} m/s2 sideways, at {at:.0f} m: '
        f'{lateral / (scn.friction * GRAVITY):.0%} of friction times g',
        'room beside it': f'at least {path.to_edge.min():.2f} m from the circle of a car '
        f'({circles.radius_m:g} m) to an edge, at {where:.0f} m (safety distance '
        f'{circles.edge_m:g} m)',
    }
    for label, text in lines.items():
        print_text(console, f'{label + ":":16}{text}')
    for actor in scn.actors:
        print_text(console, f'obstacle {actor.obstacle.id}:'.ljust(16) + _about(actor))
        print_text(console, ' ' * 16 + _meeting(scn, actor, path, circles))
    print_text(console, f'\n{CHECKED}')
    advices = advice.find_advice(scn, circles.horizon_s)
    for text in advices:
        console.print('[yellow]warning:[/] ', end='')
        print_text(console, text)
    return advices


CHECKED = (
    'checked: every key, type and range; the path lies on the road; edges neither cross nor fold '
    'back; the start is free, on the road and along the path; every obstacle touches the road '
    'during the run; the finish lies on the path ahead of the start; the path goes on for the '
    'horizon behind the finish; obstacles that drive along the road stay on it'
)


def _about(actor):
    o = actor.obstacle
    speed = np.hypot(o.vX, o.vY)
    text = f'radius {o.r_obs:g} m at ({o.X:.1f}, {o.Y:.1f}) m'
    if actor.track is not None:
        text += f', follows its way, up to {actor.track.fastest:.1f} m/s'
    elif speed:
        text += f', straight on at {speed:.1f} m/s'
    else:
        text += ', stands'
    text += f', from {actor.appears:g} s' if actor.appears else ''
    return text + (f' to {actor.disappears:g} s' if np.isfinite(actor.disappears) else '')


def _meeting(scn, actor, path, circles):
    met = encounter(scn, actor, path, circles)
    if met is None:
        return 'not there while a car on the path drives'
    if met.gap_m < 0.0:
        what = f'a car on the path would hit it (circles overlap by {-met.gap_m:.2f} m)'
    elif met.gap_m < circles.obstacle_m:
        what = (
            f'a car on the path would pass at {met.gap_m:.2f} m, inside the safety distance '
            f'({circles.obstacle_m:g} m)'
        )
    else:
        what = f'a car on the path would pass at {met.gap_m:.2f} m'
    return f'{what}, after {met.t:.1f} s, at {met.station:.0f} m'
