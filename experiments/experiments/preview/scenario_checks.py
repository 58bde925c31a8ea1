"""What a scenario holds, what is checked, and how close the coarse path comes to everything."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from rich.console import Console

from bags.command_line import print_text
from mpcc_controller.parameters import ControllerParams
from scenario_publisher import actors, advice, polyline, scenario
from scenario_publisher.actors import Actor
from scenario_publisher.advice import Advice
from scenario_publisher.scenario import Scenario

KPH = 3.6  # km/h per m/s
STEP_S = 0.01
PASSED, WARNED, FAILED, NOT_REACHED = 'pass', 'warn', 'FAIL', '-'
COLOURS = {PASSED: 'green', WARNED: 'yellow', FAILED: 'red', NOT_REACHED: 'dim'}


class Circles(NamedTuple):
    """What a controller keeps between its car and the surroundings."""

    horizon_s: float  # how far ahead it plans
    radius_m: float  # of the circle of the car
    obstacle_m: float  # safety distance to obstacles
    edge_m: float  # to road edges


class Encounter(NamedTuple):
    """How close a car that follows the path at the desired speed comes to an obstacle."""

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


def room_beside(scn: Scenario, circles: Circles) -> np.ndarray:
    """Return how far a car on the coarse path is from the nearer edge [m], sample by sample, (n,).

    From its circle, at the samples of `advice.path_demand`.
    """
    edges, ref = scn.edges, scn.reference
    left, right = (polyline.left_of(edge, ref.X, ref.Y) for edge in (edges.left, edges.right))
    return np.minimum(-left, right) - circles.radius_m


def encounter(
    scn: Scenario, actor: Actor, station: np.ndarray, circles: Circles
) -> Encounter | None:
    """Return where a car that follows the path comes closest to an obstacle, None if it is gone.

    `station` [m] is that of the samples of the path, (n,).
    """
    ref = scn.reference
    # the car starts at its place on the path, not at the first pose
    first = int(np.argmin(np.hypot(ref.X - scn.start.X, ref.Y - scn.start.Y)))
    end = min(scn.stop.time, ref.t[-1] - ref.t[first])
    times = [t for t in np.arange(0.0, end, STEP_S) if actors.is_present(actor, t)]
    if not times:
        return None
    places = [actors.obstacle_at(actor, t).discs() for t in times]
    along = ref.t[first] + np.array(times)
    X, Y = np.interp(along, ref.t, ref.X), np.interp(along, ref.t, ref.Y)
    each = zip(X, Y, places)
    apart = [min(np.hypot(x - o.X, y - o.Y) for o in discs) for x, y, discs in each]
    i = int(np.argmin(apart))
    gap = float(apart[i]) - actor.obstacle.r_obs - circles.radius_m
    return Encounter(gap, float(times[i]), float(np.interp(along[i], ref.t, station)))


def show(scn: Scenario, circles: Circles, console: Console) -> None:
    """Print what a scenario holds."""
    path, to_edge = advice.path_demand(scn), room_beside(scn, circles)
    finish = advice.finish_station(scn)
    slow, fast = path.speed.min(), path.speed.max()
    k = int(np.argmax(np.abs(path.lateral) / path.friction))
    lateral, at = abs(path.lateral[k]), path.station[k]
    where = float(path.station[np.argmin(to_edge)])
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
        f'{lateral / (path.friction[k] * advice.GRAVITY):.0%} of friction times g',
        'room beside it': f'at least {to_edge.min():.2f} m from the circle of a car '
        f'({circles.radius_m:g} m) to an edge, at {where:.0f} m (safety distance '
        f'{circles.edge_m:g} m)',
    }
    for label, text in lines.items():
        print_text(console, f'{label + ":":16}{text}')
    for actor in scn.actors:
        print_text(console, f'obstacle {actor.obstacle.id}:'.ljust(16) + _about(actor))
        print_text(console, ' ' * 16 + _meeting(scn, actor, path.station, circles))


def show_refusals(failed: str, console: Console) -> None:
    """Print what a scenario is refused for, up to the check that failed ('': none did)."""
    print_text(console, '\nchecked (a scenario that fails is refused):')
    checks = scenario.CHECKS
    reached = checks.index(failed) if failed else len(checks)
    results = [PASSED] * reached + [FAILED] + [NOT_REACHED] * len(checks)
    for check, result in zip(checks, results):
        _show_check(result, check, console)


def show_advice(judged: Sequence[Advice], console: Console) -> None:
    """Print what is rarely meant, each with whether it is so here."""
    print_text(console, '\nlooked at (allowed, but rarely meant otherwise):')
    for item in judged:
        _show_check(WARNED if item.warnings else PASSED, item.check, console)
        for text in item.warnings:
            console.print('        [yellow]warning:[/] ', end='')
            print_text(console, text)


def _show_check(result, check, console):
    console.print(f'  [{COLOURS[result]}]{result:6}[/]', end='')
    print_text(console, check + (' (not reached)' if result == NOT_REACHED else ''))


def _about(actor):
    o = actor.obstacle
    speed = np.hypot(o.vX, o.vY)
    several = f'{len(actor.discs)} discs, ' if actor.others else ''
    text = f'{several}radius {o.r_obs:g} m at ({o.X:.1f}, {o.Y:.1f}) m'
    if actor.track is not None:
        text += f', follows its way, up to {actor.track.fastest:.1f} m/s'
    elif speed:
        text += f', straight on at {speed:.1f} m/s'
    else:
        text += ', stands'
    text += f', from {actor.appears:g} s' if actor.appears else ''
    return text + (f' to {actor.disappears:g} s' if np.isfinite(actor.disappears) else '')


def _meeting(scn, actor, station, circles):
    met = encounter(scn, actor, station, circles)
    if met is None:
        return 'not there while a car on the path drives'
    what = f'pass at {met.gap_m:.2f} m'
    if met.gap_m < 0.0:
        what = f'hit it (circles overlap by {-met.gap_m:.2f} m)'
    elif met.gap_m < circles.obstacle_m:
        what += f', inside the safety distance ({circles.obstacle_m:g} m)'
    return f'a car on the path would {what}, after {met.t:.1f} s, at {met.station:.0f} m'
