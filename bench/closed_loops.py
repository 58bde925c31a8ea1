"""The closed loops of the solvers' benchmarks, driven in process without ROS."""

import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from experiments.configuration import inputs
from mpcc_controller import car_file
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.records import TickInputs, TickRecord
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import conversions, share
from msgs_yaml.conversions import NS_PER_S
from node_runtime import parameters
from scenario_publisher import scenario
from scenario_publisher.scenario import Scenario
from vehicle_plant import parameters as plant_parameters
from vehicle_plant.initial_state import Start
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import Simulator
from vehicle_plant.stepping import LockstepStepper

SCENARIOS = Path(__file__).parent / 'scenarios'
KPH = 1 / 3.6  # m/s
# of benchmarks and tests whose subject is no weight: a search has found those that ship
TOLERANCES = {
    'tolerances.contouring_m': 0.5,
    'tolerances.lag_m': 0.5,
    'tolerances.heading_rad': 0.175,
    'tolerances.velocity_mps': 3.0,
    'tolerances.steer_rate_radps': 0.349,
    'tolerances.force_rate_nps': 20_000.0,
}
PRIORITIES = {'priorities.obstacle': 1000.0, 'priorities.edge': 300.0}


class Loop(NamedTuple):
    """One closed loop, and which of its ticks are kept."""

    name: str
    scenario: str  # a name of scenario_publisher, or a file in bench/scenarios
    controller: str  # a file in mpcc_controller/config
    speed: float | None  # m/s, instead of the scenario's
    ticks: range


class Noted:
    """A StageSolver that notes the arguments, iterations and times [s] of its calls."""

    def __init__(self, inner):
        self.inner = inner
        self.forget()

    def forget(self):
        """Begin anew."""
        self.arguments, self.iterations, self.seconds = [], [], []

    def solve(self, *arguments):
        """See `StageSolver.solve`."""
        began = time.perf_counter()
        found = self.inner.solve(*arguments)
        self.seconds.append(time.perf_counter() - began)
        self.arguments.append(arguments)
        self.iterations.append(found.iterations)
        return found


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
    """Return weights by dotted name; mpcc_no_ca keeps its priorities of zero."""
    return TOLERANCES if controller == 'mpcc_no_ca' else TOLERANCES | PRIORITIES


def controller_params(name: str) -> ControllerParams:
    """Return the parameters of a controller that comes with the package, with fixed weights."""
    file = share.path('mpcc_controller', 'config', f'{name}.yaml')
    values = parameters.read_file(file).values | fixed_weights(name)
    return parameters.build(ControllerParams, values, file)


def with_solver(params: ControllerParams, **settings) -> ControllerParams:
    """Return the parameters with other settings of the solver."""
    return replace(params, solver=replace(params.solver, **settings))


def load_scenario(name: str, speed: float | None) -> Scenario:
    """Return a scenario by name or from bench/scenarios, driven at another speed where given."""
    own = SCENARIOS / name
    return inputs.load_scenario(str(own) if own.suffix == scenario.SUFFIX else name, speed)


def drive(scn: Scenario, controller: Controller) -> Iterator[TickRecord]:
    """Drive a scenario to its end as `experiments.simulation.run`; yield after every answer."""
    car = Simulator(plant_parameters.load(), scn.friction, Start(*scn.start))
    plant_side = LockstepStepper(car, RunEnd(inputs.stop_params(scn), car.now))
    controller.reset(car.actuators)
    controller.set_reference(conversions.reference_as_received(scn.reference))
    controller.set_edges(scn.edges)
    while not plant_side.outcome:
        t = (car.stamp_ns - scn.reference.stamp_ns) / NS_PER_S
        controller.set_obstacles(scenario.obstacles_at(scn, t, car.stamp_ns))
        record = controller.step(TickInputs(conversions.odometry_as_received(car.state)))
        yield record
        plant_side.tick(record.command)


def make_controller(params: ControllerParams, friction: float) -> Controller:
    """Return a controller of its parameters' car; its model has the road's friction."""
    params = replace(params, model=replace(params.model, friction=friction))
    return Controller(params, car_file.load(params))
