"""From dry road onto ice with a lane change: the road of docs/road_controller.md.

    .venv/bin/python bench/ice.py [--set controller.limits.drive_friction_use=0.5]

The road is dry, then of friction 0.25, which no message carries; 10 m later the path changes its
lane. `mpcc_road` drives 15 m/s and is to drive 32 m/s. A tick fails when the solver has no plan
that may be driven, whatever drives the car then. Exit code 1 when a solver failed, which is how
problems without a solution end, or the car slid.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import yaml

from experiments import simulation
from experiments.configuration import set_option
from experiments.families.scenario_document import document, lane_change, straight
from scenario_publisher import scenario

CONTROLLER = 'mpcc_road'
LANE_M = 3.5
SIDESLIP_DEG = 5.0  # with more the car slides
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

    @property
    def is_failed(self) -> bool:
        """Whether a solver failed."""
        return any(FAILED in name for name in self.failures)

    @property
    def is_slide(self) -> bool:
        """Whether the car slid."""
        return not self.largest_sideslip_deg <= SIDESLIP_DEG


ICE = Road(0.25, 15.0, 32.0, 40.0, 10.0, 70.0)


def road_scenario(road: Road) -> str:
    """Return the scenario of a road as YAML."""
    before = road.ice_at_m + road.change_after_m
    length = before + road.change_m + 100.0
    reach = {'from_m': road.ice_at_m, 'to_m': length + 40.0}
    reach |= {'from_offset_m': -2.5, 'to_offset_m': 6.0}
    parts = document(
        description='Dry road, then ice, on which the lane changes.',
        length=length,
        speed=road.from_mps,
        obstacles=(),
        segments=[straight(length)],
        path_segments=[straight(before), lane_change(road.change_m, LANE_M), straight(100.0)],
        patches=[{**reach, 'friction': road.friction}],
    )
    stations = [0.0, 5.0, 10.0, length]
    speeds = [road.from_mps, road.from_mps, road.to_mps, road.to_mps]
    parts['speed'] = {'stations_m': stations, 'speeds_mps': speeds}
    parts['start'] = {'progress_m': 0.0, 'speed_mps': road.from_mps}
    return yaml.safe_dump(parts)


def drive(road: Road, settings: Mapping[str, Any]) -> Result:
    """Drive a road once, with settings of the controller."""
    scn = scenario.parse(road_scenario(road), 'ice')
    setup = simulation.prepare_scenario(scn, CONTROLLER, {'controller': settings})
    columns = simulation.run(setup, explain=False)
    odometry = columns['/vehicle/odometry']
    why = [report.values for report in columns['/controller/why'].values]
    failures = Counter(f'{w["rung"]}: {w["reason"]}' for w in why if w['rung'] not in GOOD)
    sideslip = np.degrees(np.abs(np.arctan2(odometry.vy_mps, odometry.vx_mps)))
    return Result(dict(failures), float(np.max(sideslip)), float(odometry.vx_mps[-1]))


def main(argv: Sequence[str] | None = None) -> int:
    """Drive, print, and return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--set', action='append', default=[], metavar='controller.NAME=VALUE')
    settings = set_option.parse_overrides(parser.parse_args(argv).set).get('controller', {})
    result = drive(ICE, settings)
    sideslip, end = result.largest_sideslip_deg, result.end_mps
    print(f'largest sideslip {sideslip:.1f} deg, {end:.1f} m/s at the end')
    for name, count in result.failures.items():
        print(f'{count} ticks without a plan: {name}')
    return int(result.is_failed or result.is_slide)


if __name__ == '__main__':
    sys.exit(main())
