"""From dry road onto ice with a lane change: the drawn roads of docs/road_controller.md.

    .venv/bin/python bench/ice.py [--drives N] [--seed S] [--friction LEAST MOST]
        [--controller C] [--jobs N] [--set controller.limits.drive_n=6000]

The road is dry, then of another friction that no message carries; a little later the path changes
its lane. The car drives 15 m/s and is to drive 32 m/s, on ice of friction 0.25. `--drives N` draws
N roads instead: friction 0.15 to 0.6, speeds, where the ice and the lane change begin, and how long
the lane change is, which needs at most half of the friction.

A tick fails when the solver has no plan that may be driven, whatever drives the car then.
Prints a row per drive with a failure or more than 5 deg of sideslip, and the sums. The exit code is
1 when a solver failed, which is how problems without a solution end, or a car slid. Where the road
has much less than 0.3, the lowest friction that `mpcc_road` believes, cars slide: `--friction 0.3
0.6` draws roads without.
"""

import argparse
import math
import os
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from random import Random
from typing import Any, NamedTuple

import numpy as np
import yaml
from tables import markdown

from experiments import simulation
from experiments.configuration import set_option
from experiments.families.scenario_document import document, lane_change, straight
from scenario_publisher import scenario

LANE_M = 3.5
FRICTIONS, LEAST_SPEEDS, TOP_SPEEDS = (0.15, 0.6), (10.0, 20.0), (24.0, 34.0)
LATERAL_USE = 0.5  # of the friction, by the path
PEAK = 5.77  # of the lateral acceleration of a lane change, times offset over time^2
SIDESLIP_DEG = 5.0  # more is listed
FAILED = 'solver_failed'  # the reason of a problem without a solution
GOOD = ('solved', 'stopped_early')  # levels of fallback with a plan of this tick


class Road(NamedTuple):
    """Where a road becomes slippery, and what is to be driven there."""

    friction: float
    from_mps: float
    to_mps: float
    ice_at_m: float
    change_after_m: float  # of ice
    change_m: float


class Result(NamedTuple):
    """How a drive went."""

    failures: Mapping[str, int]  # ticks by level of fallback and reason
    largest_sideslip_deg: float
    end_mps: float


ICE = Road(0.25, 15.0, 32.0, 40.0, 10.0, 70.0)


def draw(random: Random, frictions: tuple[float, float] = FRICTIONS) -> Road:
    """Return a road that can be driven."""
    friction = random.uniform(*frictions)
    speed = random.uniform(*LEAST_SPEEDS)
    time = math.sqrt(PEAK * LANE_M / (LATERAL_USE * 9.81 * friction))
    return Road(
        friction,
        speed,
        random.uniform(*TOP_SPEEDS),
        random.uniform(20.0, 60.0),
        random.uniform(0.0, 30.0),
        # of a speed that the driving force allows until then
        (speed + 4.0) * time * random.uniform(1.0, 1.5),
    )


def road_scenario(road: Road) -> str:
    """Return the scenario of a road as YAML."""
    before = road.ice_at_m + road.change_after_m
    segments = [straight(before), lane_change(road.change_m, LANE_M), straight(100.0)]
    length = before + road.change_m + 100.0
    parts = document(
        description='Dry road, then ice, on which the lane changes.',
        length=length,
        speed=road.from_mps,
        obstacles=(),
        segments=[straight(length)],
        path_segments=segments,
        patches=[
            {
                'from_m': road.ice_at_m,
                'to_m': length + 40.0,
                'from_offset_m': -2.5,
                'to_offset_m': 6.0,
                'friction': road.friction,
            }
        ],
    )
    stations = [0.0, 5.0, 10.0, length]
    speeds = [road.from_mps, road.from_mps, road.to_mps, road.to_mps]
    parts['speed'] = {'stations_m': stations, 'speeds_mps': speeds}
    parts['start'] = {'progress_m': 0.0, 'speed_mps': road.from_mps}
    return yaml.safe_dump(parts)


def drive(road: Road, controller: str, settings: Mapping[str, Any]) -> Result:
    """Drive a road once."""
    scn = scenario.parse(road_scenario(road), 'ice')
    setup = simulation.prepare_scenario(scn, controller, {'controller': settings})
    columns = simulation.run(setup, explain=False)
    odometry = columns['/vehicle/odometry']
    why = [report.values for report in columns['/controller/why'].values]
    failures = Counter(f'{w["rung"]}: {w["reason"]}' for w in why if w['rung'] not in GOOD)
    sideslip = np.degrees(np.abs(np.arctan2(odometry.vy_mps, odometry.vx_mps)))
    return Result(dict(failures), float(np.max(sideslip)), float(odometry.vx_mps[-1]))


def table(results: Sequence[tuple[Road, Result]]) -> str:
    """Return a row per drive that failed or slid."""
    rows = [
        (
            f'{road.friction:.2f}, {road.from_mps:.1f} to {road.to_mps:.1f} m/s',
            f'{result.largest_sideslip_deg:.1f}',
            f'{result.end_mps:.1f}',
            ', '.join(f'{count} {name}' for name, count in result.failures.items()),
        )
        for road, result in results
        if result.failures or is_slide(result)
    ]
    columns = ('friction, speed', 'sideslip [deg]', 'end [m/s]', 'ticks without a plan')
    return markdown('Drives with a failure or a slide', columns, rows)


def is_failed(result: Result) -> bool:
    """Return whether a solver failed."""
    return any(FAILED in name for name in result.failures)


def is_slide(result: Result) -> bool:
    """Return whether the car slid."""
    return not result.largest_sideslip_deg <= SIDESLIP_DEG


def main(argv: Sequence[str] | None = None) -> int:
    """Drive, print, and return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--drives', type=int, default=0, help='drawn roads (default: the one)')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument(
        '--friction', type=float, nargs=2, default=FRICTIONS, metavar=('LEAST', 'MOST')
    )
    parser.add_argument('--controller', default='mpcc_road')
    parser.add_argument('--set', action='append', default=[], metavar='controller.NAME=VALUE')
    parser.add_argument('--jobs', type=int, default=os.cpu_count())
    args = parser.parse_args(argv)
    settings = set_option.parse_overrides(args.set).get('controller', {})
    frictions = tuple(args.friction)
    roads = [draw(Random(f'{args.seed} {i}'), frictions) for i in range(args.drives)] or [ICE]
    one = partial(drive, controller=args.controller, settings=settings)
    with ProcessPoolExecutor(min(args.jobs, len(roads))) as pool:
        results = [*zip(roads, pool.map(one, roads))]
    failed = sum(is_failed(result) for _, result in results)
    slid = sum(is_slide(result) for _, result in results)
    print(table(results))
    print(
        f'{len(roads)} drives: {failed} with a solver that failed, '
        f'{sum(bool(result.failures) for _, result in results)} with a tick without a plan, '
        f'{slid} with more than {SIDESLIP_DEG:g} deg of sideslip'
    )
    return int(failed > 0 or slid > 0)


if __name__ == '__main__':
    sys.exit(main())
