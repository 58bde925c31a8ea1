"""A scenario before it is driven: what it holds and what is checked, as text and as a picture.

The picture is the scenario from above, with safety distances, over its speed and lateral
acceleration.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console

from bags.command_line import print_text
from bags.evaluation import geometry
from bags.figures import style
from mpcc_controller.parameters import ControllerParams
from scenario_publisher import actors, advice, polyline, scenario
from scenario_publisher.actors import Actor
from scenario_publisher.advice import Advice
from scenario_publisher.scenario import Scenario

KPH = 3.6  # km/h per m/s
STEP_S = 0.01
PASSED, WARNED, FAILED, NOT_REACHED = 'pass', 'warn', 'FAIL', '-'
COLOURS = {PASSED: 'green', WARNED: 'yellow', FAILED: 'red', NOT_REACHED: 'dim'}
WIDE_INCH, STRIP_INCH, LEAST_INCH, MOST_INCH = 11.0, 1.7, 2.4, 8.0
PLACE_S = 1.0  # between two drawn places of an obstacle that moves
SHOWN_S = 10.0  # of the motion of an obstacle
MARGIN_M = 4.0
ROAD, PATH, OBSTACLE, SLIPPERY, SPEED = '#ececec', '#0072B2', '#CC3311', '#9bd3e6', '#009E73'


class Encounter(NamedTuple):
    """How close a car that follows the path at the desired speed comes to an obstacle."""

    gap_m: float  # between the circles; negative: they overlap
    t: float  # s after the start
    station: float  # m


def encounter(
    scn: Scenario, actor: Actor, station: np.ndarray, params: ControllerParams
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
    gap = float(apart[i]) - actor.obstacle.r_obs - params.body.circle_radius_m
    return Encounter(gap, float(times[i]), float(np.interp(along[i], ref.t, station)))


def show(scn: Scenario, params: ControllerParams, console: Console) -> None:
    """Print what a scenario holds, for a controller with these parameters."""
    path, edges, ref = advice.path_demand(scn), scn.edges, scn.reference
    left, right = (polyline.left_of(edge, ref.X, ref.Y) for edge in (edges.left, edges.right))
    to_edge = np.minimum(-left, right) - params.body.circle_radius_m  # (n,) m, of its circle
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
        f'({params.body.circle_radius_m:g} m) to an edge, at {where:.0f} m (safety distance '
        f'{params.safety.edge_m:g} m)',
    }
    for label, text in lines.items():
        print_text(console, f'{label + ":":16}{text}')
    for actor in scn.actors:
        print_text(console, f'obstacle {actor.obstacle.id}:'.ljust(16) + _about(actor))
        print_text(console, ' ' * 16 + _meeting(scn, actor, path.station, params))


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


def _meeting(scn, actor, station, params):
    met, safe = encounter(scn, actor, station, params), params.safety.obstacle_m
    if met is None:
        return 'not there while a car on the path drives'
    what = f'pass at {met.gap_m:.2f} m'
    if met.gap_m < 0.0:
        what = f'hit it (circles overlap by {-met.gap_m:.2f} m)'
    elif met.gap_m < safe:
        what += f', inside the safety distance ({safe:g} m)'
    return f'a car on the path would {what}, after {met.t:.1f} s, at {met.station:.0f} m'


def draw(scn: Scenario, params: ControllerParams, path: Path) -> Path:
    """Draw a scenario into a file, PNG or SVG by its suffix; return it."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    low, high = _extent(scn)
    size = high - low
    above = float(np.clip(WIDE_INCH * size[1] / size[0], LEAST_INCH, MOST_INCH))
    with rc_context({**style.RC, 'svg.fonttype': 'none', 'svg.hashsalt': scn.name}):
        figure = Figure(figsize=(WIDE_INCH, above + 2 * STRIP_INCH), layout='constrained')
        top, speed, lateral = figure.subplots(3, 1, height_ratios=(above, STRIP_INCH, STRIP_INCH))
        speed.sharex(lateral)
        _from_above(top, scn, params)
        # where the shape allows it the scales are equal; a long road is stretched across
        stretch = size[0] / size[1] / (WIDE_INCH / above)
        top.set_xlim(low[0], high[0])
        top.set_ylim(low[1], high[1])
        if stretch < 1.5:
            top.set_aspect('equal', adjustable='box')
        _strips(speed, lateral, scn)
        scale = f'; across stretched {stretch:.1f} times' if stretch >= 1.5 else ''
        top.set_title(f'{scn.name}: {scn.start.speed:.1f} m/s, friction {scn.friction:g}{scale}')
        figure.legend(*top.get_legend_handles_labels(), loc='outside lower center', ncols=7)
        figure.savefig(path, dpi=130, metadata={'Date': None} if path.suffix == '.svg' else None)
    return path


def _from_above(axes, scn, params):
    from matplotlib.patches import Circle, Polygon

    left, right = scn.edges.left, scn.edges.right
    axes.add_patch(Polygon(np.concatenate([left, right[::-1]]), color=ROAD, lw=0, label='road'))
    for i, corners in enumerate(np.reshape(scn.patches.corners_m, (-1, 4, 2))):
        axes.add_patch(Polygon(corners, color=SLIPPERY, lw=0, label='' if i else 'other friction'))
    for edge in (left, right):
        axes.plot(*edge.T, color=style.EDGE, lw=1.0)
    for edge, inside in ((left, -params.safety.edge_m), (right, params.safety.edge_m)):
        safe = geometry.offset_polyline(edge, inside)
        axes.plot(*safe.T, color=style.UNSAFE, lw=0.8, ls=':')
    axes.plot(scn.reference.X, scn.reference.Y, color=PATH, lw=1.4, label='coarse path')
    named = set()
    for actor in scn.actors:
        for count, (t, o) in enumerate(_places(scn, actor)):
            alpha = 0.85 if count == 0 else 0.25
            for d in o.discs():
                axes.add_patch(Circle((d.X, d.Y), d.r_obs, color=OBSTACLE, alpha=alpha, lw=0))
                safe = d.r_obs + params.safety.obstacle_m
                ring = Circle((d.X, d.Y), safe, fill=False, ec=style.UNSAFE, ls=':', lw=0.8)
                axes.add_patch(ring)
            if count and count % 2 == 0:
                axes.annotate(f'{t:.0f} s', (o.X, o.Y), fontsize=6.5, ha='center', va='center')
        o = actor.obstacle
        if np.hypot(o.vX, o.vY) or actor.track is not None:
            way = np.array([(p.X, p.Y) for _, p in _places(scn, actor, 0.1)])
            axes.plot(*way.T, color=OBSTACLE, lw=0.8, ls='--')
        text = f'{o.id}' + (f', from {actor.appears:g} s' if actor.appears else '')
        if (text, round(o.X), round(o.Y)) not in named:
            named.add((text, round(o.X), round(o.Y)))
            axes.annotate(
                text, (o.X, o.Y + o.r_obs), (0, 5), textcoords='offset points', ha='center'
            )
    start = (scn.start.X, scn.start.Y)
    axes.add_patch(Circle(start, params.body.circle_radius_m, fill=False, ec=PATH, lw=1.2))
    forward = np.array([np.cos(scn.start.psi), np.sin(scn.start.psi)])
    axes.annotate(
        '', np.array(start) + 8.0 * forward, start, arrowprops={'arrowstyle': '-|>', 'color': PATH}
    )
    across = np.array([-np.sin(scn.stop.psi), np.cos(scn.stop.psi)])
    line = np.array([scn.stop.X, scn.stop.Y]) + np.outer([-6.0, 6.0], across)
    axes.plot(*line.T, color=style.INK, ls=(0, (2, 2)), lw=1.2, label='finish')
    axes.plot([], [], color=style.UNSAFE, ls=':', lw=0.8, label='safety distance')
    axes.plot([], [], 'o', color=OBSTACLE, label='obstacle, every second')
    axes.plot([], [], 'o', mfc='none', color=PATH, label='circle of the car')
    axes.set_xlabel('x [m]')
    axes.set_ylabel('y [m]')


def _strips(speed, lateral, scn):
    along = advice.path_demand(scn)
    speed.plot(along.station, along.speed, color=SPEED)
    speed.set_ylabel('desired\nspeed [m/s]')
    speed.set_ylim(0.0, 1.25 * along.speed.max())
    limit = along.friction * advice.GRAVITY
    lateral.plot(along.station, along.lateral, color=PATH)
    for sign in (-1.0, 1.0):
        lateral.plot(along.station, sign * limit, color=style.COLLISION, ls=':', lw=0.9)
    lateral.annotate(
        'friction x g',
        (along.station[0], limit[0]),
        (2, -10),
        fontsize=7.5,
        textcoords='offset points',
        color=style.COLLISION,
    )
    reach = max(1.15 * limit.max(), 1.1 * np.abs(along.lateral).max())
    lateral.set_ylim(-reach, reach)
    lateral.set_ylabel('lateral acc. of\nthe path [m/s²]')
    lateral.set_xlabel('station of the path [m]')
    lateral.set_xlim(along.station[0], along.station[-1])
    for axes in (speed, lateral):
        axes.axvline(advice.finish_station(scn), color=style.INK, ls=(0, (2, 2)), lw=1.2)


def _places(scn, actor, step=PLACE_S):
    """Yield times and an obstacle at them, while it is there."""
    until = min(actor.disappears, scn.stop.time, actor.appears + SHOWN_S)
    still = actor.track is None and not (actor.obstacle.vX or actor.obstacle.vY)
    for t in [actor.appears] if still else np.arange(actor.appears, until, step):
        yield float(t), actors.obstacle_at(actor, float(t))


def _extent(scn):
    """Return the corners [m] of what is drawn: the path and the road beside it."""
    ref = scn.reference
    path = np.column_stack([ref.X, ref.Y])
    low, high = path.min(axis=0) - 12.0, path.max(axis=0) + 12.0
    edges = np.concatenate([scn.edges.left, scn.edges.right])
    near = edges[np.all((edges > low) & (edges < high), axis=1)]
    shown = np.concatenate([path, near])
    return shown.min(axis=0) - MARGIN_M, shown.max(axis=0) + MARGIN_M
