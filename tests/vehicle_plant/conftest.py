from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from msgs_yaml.types import Command
from vehicle_plant import integrator, parameters
from vehicle_plant.initial_state import Start
from vehicle_plant.simulator import TICK_STEPS, Simulator
from vehicle_plant.state import join_trajectories


@pytest.fixture(scope='session')
def params():
    return parameters.load()


@pytest.fixture(scope='session')
def bare(params):
    """The published tyre: every scaling factor one."""
    ones = dict.fromkeys(vars(params.car.scaling.front), 1.0)
    return replace(params.car.scaling.front, **ones)


@pytest.fixture(scope='session')
def drive(params):
    """Drive a law(t, car) -> (delta, Fxf, Fxr) for some seconds from a straight start.

    Wheels may be locked on purpose: the gate's friction budget is opened.
    """

    def driven(law, seconds, speed, friction=1.0, plant=params):
        gate = replace(plant.car.gate, friction_use=10.0)
        plant = replace(plant, car=replace(plant.car, gate=gate))
        car = Simulator(plant, friction, Start(0.0, 0.0, 0.0, speed))
        tracks = []
        for tick in range(round(seconds * 20)):
            delta, Fxf, Fxr = law(tick / 20, car)
            tracks.append(car.advance(Command(car.stamp_ns, delta, 0.0, Fxf, Fxr), TICK_STEPS))
        assert car.gate.rejected == 0, car.gate.last_reason
        return join_trajectories(tracks)

    return driven


@pytest.fixture
def rng():
    return np.random.default_rng(20240501)


@pytest.fixture(scope='session')
def advance_interpreted():
    """Return the last state and the rows of `integrator.advance`, without compiled code."""

    def advance(x, set_points, p, patches=None, model=integrator.DOUBLE_TRACK):
        derivative, projection = integrator.plant_functions(model)
        h, rows = integrator.STEP_S, []

        def local(x):
            return p if patches is None else integrator.with_local_friction(x, p, patches, model)

        for begin, end in pairwise(set_points):
            middle, here = (begin + end) * 0.5, local(x)
            k1 = derivative(x, begin, here)[0]
            k2 = derivative(x + h * 0.5 * k1, middle, here)[0]
            k3 = derivative(x + h * 0.5 * k2, middle, here)[0]
            k4 = derivative(x + h * k3, end, here)[0]
            x = np.asarray(projection(x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4), here)).ravel()
            rows.append(integrator.row(x, end, local(x), model))
        return x, np.array(rows)

    return advance
