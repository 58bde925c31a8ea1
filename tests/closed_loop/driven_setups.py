"""Drives in process, evaluated; and a drive tick by tick."""

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any, NamedTuple

from closed_loops import fixed_weights

from bags.evaluation.drive import Drive, drive_from_columns
from bags.evaluation.metrics import compute_metrics
from experiments import simulation
from experiments.configuration import inputs
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.records import TickInputs
from msgs_yaml import conversions
from msgs_yaml.conversions import NS_PER_S
from scenario_publisher import scenario
from vehicle_plant.initial_state import Start
from vehicle_plant.run_end import RunEnd
from vehicle_plant.simulator import TICK_STEPS, Simulator

UNWATCHED = nullcontext()


class Driven(NamedTuple):
    """A drive that was simulated."""

    setup: simulation.Setup
    columns: dict[str, Any]
    drive: Drive
    metrics: dict[str, Any]

    @property
    def reports(self) -> list[dict[str, Any]]:
        """The values of /controller/why, tick by tick."""
        return [why.values for why in self.columns['/controller/why'].values]


def prepare(scenario, controller, settings: Mapping = {}, speed_mps=None) -> simulation.Setup:
    """Return `simulation.prepare` with the weights of tests, but where settings name others."""
    own = {'controller': fixed_weights(controller) | settings.get('controller', {})}
    return simulation.prepare(scenario, controller, settings | own, speed_mps)


def driven(setup: simulation.Setup, explain: bool = False) -> Driven:
    """Simulate and evaluate a setup; see `simulation.run`."""
    columns = simulation.run(setup, explain)
    drive = drive_from_columns(columns, simulation.run_info(setup), setup.controller)
    return Driven(setup, columns, drive, compute_metrics(drive))


class Loop:
    """Controller and plant tick by tick, for tests that change something meanwhile."""

    def __init__(self, setup: simulation.Setup, controller: Controller):
        """Begin at the start of the scenario."""
        self.scn, self.controller = setup.scn, controller
        self.car = Simulator(setup.plant, self.scn.friction, Start(*self.scn.start))
        self.end, self.outcome = RunEnd(inputs.stop_params(self.scn), self.car.now), None
        controller.reset(self.car.actuators)
        reference = conversions.reference_as_received(self.scn.reference)
        assert not controller.set_reference(reference)
        assert not controller.set_edges(self.scn.edges)
        self.records, self.states, self.whys, self.obstacles = [], [], [], []

    def tick(self, watched: AbstractContextManager = UNWATCHED) -> None:
        """Answer the state, with the calls of the controller inside `watched`."""
        x = conversions.odometry_as_received(self.car.state)
        t = (self.car.stamp_ns - self.scn.reference.stamp_ns) / NS_PER_S
        self.obstacles.append(scenario.obstacles_at(self.scn, t, self.car.stamp_ns))
        self.controller.set_obstacles(self.obstacles[-1])
        with watched:
            record = self.controller.step(TickInputs(x))
            self.whys.append(self.controller.report(record)[1])
            self.controller.prepare()
        self.records.append(record)
        self.states.append(x)
        now = self.car.advance(record.command, TICK_STEPS)
        self.outcome = self.end.check(now)
