"""The closed loops of the solvers' benchmarks, driven in process without ROS."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from experiments import simulation
from experiments.simulation import Setup
from experiments.tuned_study.arms import BY_HAND
from scenario_publisher import scenario

SCENARIOS = Path(__file__).parent / 'scenarios'
KPH = 1 / 3.6  # m/s


class Loop(NamedTuple):
    """One closed loop, and which of its ticks are kept."""

    name: str
    scenario: str  # a name of scenario_publisher, or a file in bench/scenarios
    controller: str  # a file in mpcc_controller/config
    speed: float | None  # m/s, instead of the scenario's
    ticks: range


ALL = range(10**6)
SWERVE = range(125)  # until the last obstacle is passed
FULL = (
    Loop('double lane change, 68 km/h', 'double_lane_change', 'mpcc', 68 * KPH, SWERVE),
    Loop('double lane change, 75 km/h', 'double_lane_change', 'mpcc', 75 * KPH, SWERVE),
    Loop('double lane change, 80 km/h', 'double_lane_change', 'mpcc', 80 * KPH, SWERVE),
    # around the obstacle: the rest of the lap is the same again and again
    Loop('circle', 'circle_20m', 'mpcc', None, range(70, 120)),
    Loop('circle, no collision avoidance', 'circle_20m', 'mpcc_no_ca', None, range(70, 120)),
    Loop('pop-up obstacles', 'pop_up.yaml', 'mpcc', None, range(10, 190)),
    Loop('moving obstacles', 'narrow_road.yaml', 'mpcc', None, range(160)),
    Loop('wet road', 'wet_road.yaml', 'mpcc', None, ALL),
)
# a few ticks of some, where something happens
QUICK = (
    FULL[1]._replace(ticks=range(20, 45)),
    FULL[3]._replace(ticks=range(90, 95)),
    FULL[4]._replace(ticks=range(90, 95)),
    FULL[5]._replace(ticks=range(15, 30)),
    FULL[7]._replace(ticks=range(40, 50)),
)


def fixed_weights(controller: str) -> Mapping[str, float]:
    """Return weights by dotted name, of benchmarks and tests whose subject is no weight.

    They are not those that ship, which a search has found; mpcc_no_ca keeps its priorities of zero.
    """
    kept = 'priorities.' if controller == 'mpcc_no_ca' else ()
    return {name: value for name, value in BY_HAND.items() if not name.startswith(kept)}


def make_setup(loop: Loop) -> Setup:
    """Return the simulation of a loop, with fixed weights."""
    own = SCENARIOS / loop.scenario
    name = str(own) if own.suffix == scenario.SUFFIX else loop.scenario
    weights = {'controller': fixed_weights(loop.controller)}
    return simulation.prepare(name, loop.controller, weights, loop.speed)
