"""Runs of the ring in process, each made once."""

import dataclasses
from functools import cache

import pytest

from bags.verdict import metrics, recorded
from experiments import simulation
from mpcc_controller import car_file
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import share
from node_runtime import parameters
from scenario_publisher import scenario
from vehicle_plant import parameters as plant_parameters


class Ring:
    """The double lane change and whatever else a test drives, by controller name."""

    def __init__(self):
        self.plant = plant_parameters.load()
        self.drive = cache(self.drive)

    def parts(self, scene, controller):
        """Return scenario, controller and car parameters."""
        file = share.path('mpcc_controller', 'config', f'{controller}.yaml')
        params = parameters.load(ControllerParams, file)
        return scenario.load(scene), params, car_file.load(params)

    def fresh(self, scene, controller):
        """Drive once more, whatever was driven before."""
        return simulation.run(*self.parts(scene, controller), self.plant)

    def drive(self, scene, controller):
        """Return the columns of a drive, and the drive as the judge takes it."""
        columns = self.fresh(scene, controller)
        scn, *params = self.parts(scene, controller)
        notes = simulation.run_info(scn, controller, *params, self.plant)
        return columns, recorded.of(columns, notes, controller)

    def ablated(self, scene, controller, **rules):
        """Drive with other rules of the cost and return the drive as the judge takes it."""
        scn, params, vehicle = self.parts(scene, controller)
        changed = dataclasses.replace(params.formulation, **rules)
        parts = scn, dataclasses.replace(params, formulation=changed), vehicle
        columns = simulation.run(*parts, self.plant)
        scn, *params = parts
        notes = simulation.run_info(scn, controller, *params, self.plant)
        return recorded.of(columns, notes, controller)

    def metrics(self, scene, controller):
        """Return the metrics of a drive."""
        return metrics.of(self.drive(scene, controller)[1])


@pytest.fixture(scope='session')
def ring():
    return Ring()
