"""Runs simulated in process, each once."""

import dataclasses
from functools import cache

import pytest

from bags.evaluation.drive import drive_from_columns
from bags.evaluation.metrics import compute_metrics
from experiments import simulation
from mpcc_controller import car_file
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import share
from node_runtime import parameters
from scenario_publisher import scenario
from vehicle_plant import parameters as plant_parameters


class SimulatedRuns:
    """Runs of the shipped controllers, simulated once each, by scenario and controller name."""

    def __init__(self):
        self.plant = plant_parameters.load()
        self.drive = cache(self.drive)

    def parts(self, scene, controller):
        """Return scenario, controller and car parameters."""
        file = share.path('mpcc_controller', 'config', f'{controller}.yaml')
        params = parameters.load(ControllerParams, file)
        return scenario.load(scene), params, car_file.load(params)

    def setup(self, scene, controller):
        """Return the setup with the parameters of the files as they are."""
        scn, params, vehicle = self.parts(scene, controller)
        return simulation.Setup(controller, scn, params, vehicle, self.plant, scn.friction)

    def fresh(self, scene, controller):
        """Return the columns of a new simulation."""
        return simulation.run(self.setup(scene, controller))

    def drive(self, scene, controller):
        """Return the columns of a run, and its Drive."""
        setup = self.setup(scene, controller)
        columns = simulation.run(setup)
        return columns, drive_from_columns(columns, simulation.run_info(setup), controller)

    def ablated(self, scene, controller, **rules):
        """Return the Drive of a run with other rules of the cost."""
        setup = self.setup(scene, controller)
        formulation = dataclasses.replace(setup.params.formulation, **rules)
        params = dataclasses.replace(setup.params, formulation=formulation)
        return simulation.drive(setup._replace(params=params))

    def metrics(self, scene, controller):
        """Return the metrics of a run."""
        return compute_metrics(self.drive(scene, controller)[1])


@pytest.fixture(scope='session')
def simulated():
    return SimulatedRuns()
