"""From which slides does a controller save the car? The maps of docs/road_controller.md.

    .venv/bin/python bench/recovery_map.py [CONTROLLER ...] [--quick]

The car starts in the middle of a straight road of 8 m. It moves along the road; its heading is off
by the sideslip angle, and it yaws. Wheels are straight, as if the slide came from the road; by
symmetry only sideslip to the left is driven, with yaw rates of both signs. A drive counts as

recovered   sideslip below 5 deg and yaw rate below 0.1 rad/s for half a second, without a spin:
            the sideslip stayed below 90 deg
on the road recovered, and the wheels' contact points stayed within the road until then

A controller is a name or a YAML file; `fallback` is mpcc whose solvers always fail, so that its
fallback alone drives, `recovery` the same with the recovery law. --quick drives every second angle,
yaw rate and speed. Writes recovery_map.md and .png beside this file.
"""

import argparse
import itertools
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import yaml
from matplotlib.figure import Figure
from tables import markdown, share

from experiments import simulation
from experiments.families.scenario_document import document
from experiments.simulation import Setup
from scenario_publisher import scenario
from vehicle_plant import suspension

SIDESLIPS_RAD = np.radians((0, 5, 10, 15, 20, 25, 30))
YAW_RATES_RADPS = (-1.0, -0.75, -0.5, -0.25, 0.0, 0.25, 0.5, 0.75, 1.0)
SPEEDS_MPS = (15.0, 20.0, 25.0, 30.0)
ROAD_M, LENGTH_M, TIME_S = 8.0, 300.0, 5.0
SETTLED_SIDESLIP_RAD, SETTLED_YAW_RATE_RADPS, SETTLED_S = np.radians(5.0), 0.1, 0.5
SPUN_RAD = np.radians(90.0)
LEAST_MPS = 1.0  # a slower car has no sideslip angle: it counts as stopped, which is settled
FAILING = {'solver.max_iterations': 1}
SPECIAL = {'fallback': FAILING, 'recovery': FAILING | {'fallback.recovery': True}}


class Slide(NamedTuple):
    """How the car slides at the start."""

    sideslip_rad: float
    yaw_rate_radps: float
    speed_mps: float


class Ending(NamedTuple):
    """How a drive went."""

    recovered: bool
    on_road: bool
    settled_s: float | None  # from the start


def slide_scenario(slide: Slide) -> str:
    """Return the scenario of a car that slides along a straight road, as YAML."""
    beta, speed = slide.sideslip_rad, slide.speed_mps
    start = {'x_m': 0.0, 'y_m': 0.0, 'yaw_rad': -float(beta)}
    start |= {'speed_mps': float(speed * np.cos(beta)), 'lateral_mps': float(speed * np.sin(beta))}
    parts = document(
        description='A car that slides along a straight road.',
        length=LENGTH_M,
        speed=speed,
        obstacles=(),
        left=ROAD_M / 2,
        right=-ROAD_M / 2,
    )
    parts['start'] = start | {'yaw_rate_radps': float(slide.yaw_rate_radps)}
    parts['stop']['time_s'] = TIME_S
    return yaml.safe_dump(parts)


def drive(setup: Setup, slide: Slide) -> Ending:
    """Drive from a slide until the car is settled, spins or the time is up."""
    setup = setup._replace(scn=scenario.parse(slide_scenario(slide), 'slide'))
    odometry = simulation.run(setup, explain=False)['/vehicle/odometry']
    return ending(odometry, setup.plant)


def ending(odometry, plant) -> Ending:
    """Return how a drive went, from its odometry and the plant's dimensions."""
    _, t, _, Y, psi, vx, vy, r = odometry
    moving = np.hypot(vx, vy) > LEAST_MPS
    beta = np.where(moving, np.arctan2(vy, vx), 0.0)
    calm = (np.abs(beta) < SETTLED_SIDESLIP_RAD) & (np.abs(r) < SETTLED_YAW_RATE_RADPS)
    since = t - np.maximum.accumulate(np.where(calm, 0.0, t))  # how long it has been calm
    spun_s = t[np.abs(beta) > SPUN_RAD].min(initial=np.inf)
    settled = np.flatnonzero(calm & (since >= SETTLED_S) & (t < spun_s))
    end = settled[0] if settled.size else len(t) - 1
    corners = suspension.wheel_corners(plant.car)
    c, s = np.cos(psi[: end + 1]), np.sin(psi[: end + 1])
    offset = max(np.abs(Y[: end + 1] + s * k.x + c * k.y).max() for k in corners)
    if not settled.size:
        return Ending(False, False, None)
    return Ending(True, bool(offset <= ROAD_M / 2), float(t[end] - SETTLED_S))


def grid(quick: bool = False) -> list[Slide]:
    """Return the slides of the map."""
    axes = (SIDESLIPS_RAD.tolist(), YAW_RATES_RADPS, SPEEDS_MPS)
    slides = itertools.product(*(values[:: 2 if quick else 1] for values in axes))
    return [Slide(*slide) for slide in slides if slide[0] or slide[1] >= 0]  # mirrored


def table(drives: pd.DataFrame) -> str:
    """Return the shares recovered, of all and by speed, and on the road."""
    speeds = sorted(drives.speed_mps.unique())
    rows = []
    for name, own in drives.groupby('controller', sort=False):
        by_speed = own.groupby('speed_mps').recovered.mean()
        shares = map(share, (own.recovered.mean(), own.on_road.mean()))
        median = own.settled_s.median()
        text = '-' if np.isnan(median) else f'{median:.2f} s'
        rows.append((name, len(own), *shares, text, *map(share, by_speed)))
    columns = ('controller', 'drives', 'recovered', 'on the road', 'median time')
    return markdown('Slides that end well', (*columns, *(f'{v:g} m/s' for v in speeds)), rows)


def figure(drives: pd.DataFrame) -> Figure:
    """Return the maps: a row per controller, a column per speed."""
    names, speeds = drives.controller.unique(), sorted(drives.speed_mps.unique())
    size = 2.6 * len(speeds) + 1.0, 2.1 * len(names) + 0.8
    fig = Figure(figsize=size, layout='constrained')
    axes = fig.subplots(len(names), len(speeds), sharex=True, sharey=True, squeeze=False)
    kinds = (('lost', '#b2182b', 'x'), ('off the road', '#e08214', 'o'), ('saved', '#1b7837', 'o'))
    rank = drives.recovered.astype(int) + drives.on_road
    for row, name in zip(axes, names):
        for ax, speed in zip(row, speeds):
            here = (drives.controller == name) & (drives.speed_mps == speed)
            for k, (label, colour, marker) in enumerate(kinds):
                own = drives[here & (rank == k)]
                x, y = np.degrees(own.sideslip_rad), own.yaw_rate_radps
                ax.plot(x, y, marker, color=colour, markersize=4, label=label)
            ax.set_title(f'{name}, {speed:g} m/s', fontsize=8)
        row[0].set_ylabel('yaw rate / rad/s')
    for ax in axes[-1]:
        ax.set_xlabel('sideslip / deg')
    axes[0, -1].legend(fontsize=7, loc='upper right')
    return fig


def main() -> None:
    """Drive the map and write table, figure and numbers."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    names = ['fallback', 'recovery', 'mpcc', 'mpcc_road']
    parser.add_argument('controllers', nargs='*', default=names, metavar='CONTROLLER')
    parser.add_argument('--quick', action='store_true', help='every second angle and speed')
    options = parser.parse_args()
    slides, rows = grid(options.quick), []
    with ProcessPoolExecutor() as pool:
        for name in options.controllers:
            controller, settings = ('mpcc', SPECIAL[name]) if name in SPECIAL else (name, {})
            setup = simulation.prepare('straight', controller, {'controller': settings})
            endings = pool.map(partial(drive, setup), slides, chunksize=4)
            rows += [(Path(name).stem, *slide, *end) for slide, end in zip(slides, endings)]
    drives = pd.DataFrame(rows, columns=['controller', *Slide._fields, *Ending._fields])
    result = table(drives)
    print(result)
    here = Path(__file__)
    here.with_suffix('.md').write_text(result)
    figure(drives).savefig(here.with_suffix('.png'), dpi=130)


if __name__ == '__main__':
    main()
