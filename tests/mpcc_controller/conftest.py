"""A controller, roads to drive on, and the prediction model itself as the car."""

import dataclasses
from functools import cache
from types import SimpleNamespace
from typing import NamedTuple

import casadi as ca
import numpy as np
import pytest
from closed_loops import fixed_weights

from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.records import TickInputs
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.parameters import (
    CarActuators,
    CarBody,
    CarOutline,
    CarParams,
    ControllerParams,
    Tyre,
)
from mpcc_controller.path import reference_path, road_edges
from mpcc_controller.problem import stage_parameters
from mpcc_controller.problem.obstacle_motion import PredictedObstacle
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml import share
from msgs_yaml.types import Actuators, Obstacle, Obstacles, Reference, RoadEdges, VehicleState
from node_runtime import parameters

TICK_S = 0.05
FINE_STEPS = 10  # of the car per tick
# separate car parameters, so that a new identification of the plant changes no test here
CAR = CarParams(
    CarBody(1850.0, 3300.0, 1.43, 1.46, 0.54, 0.4, 180.0),
    Tyre(144e3, 198e3, 0.88, 0.92, None),
    CarActuators(0.0, 0.48, 0.8, 28e3, 7e3, 200e3, 0.0516, 0.072),
    CarOutline(2.19, 2.46, 1.82),
)
# switches the friction estimate on, as `changes` of `load`
ESTIMATE = {
    'friction_estimate__on': True,
    'friction_estimate__lowest': 0.3,
    'friction_estimate__quantile': 0.2,
    'friction_estimate__spread': 0.05,
    'friction_estimate__doubt': 0.1,
    'friction_estimate__memory_s': 3.0,
    'friction_estimate__speed_noise_mps': 0.05,
    'friction_estimate__lateral_noise_mps': 0.03,
    'friction_estimate__yaw_rate_noise_radps': 0.015,
    'friction_estimate__sideslip_error_rad': 0.01,
    'friction_estimate__lag_error_s': 0.0,
}
REST = Actuators(0, 0.0, 0.0, 0.0, 0.0, (0.0,) * 4)


def load(name='mpcc', **changes):
    """Return (parameters with the weights of tests, car); changes are `group__field=value`."""
    file = share.path('mpcc_controller', 'config', f'{name}.yaml')
    values = parameters.read_file(file).values | fixed_weights(name)
    params = parameters.build(ControllerParams, values, file)
    for key, value in changes.items():
        group, field = key.split('__')
        block = dataclasses.replace(getattr(params, group), **{field: value})
        params = dataclasses.replace(params, **{group: block})
    return params, CAR


class Situation(NamedTuple):
    """A road with obstacles."""

    reference: Reference
    edges: RoadEdges
    obstacles: Obstacles


def path(X, Y, v):
    X, Y = np.asarray(X, float), np.asarray(Y, float)
    psi = np.unwrap(np.arctan2(np.gradient(Y), np.gradient(X)))
    t = np.concatenate(([0], np.cumsum(np.hypot(np.diff(X), np.diff(Y))))) / v
    return Reference(0, X, Y, psi, t)


def straight(v=20.0, obstacles=(), left=6.0, right=-6.0):
    X = np.arange(0.0, 300.0, 1.0)
    sides = [np.array([[-50.0, y], [350.0, y]]) for y in (left, right)]
    return Situation(path(X, 0 * X, v), RoadEdges(0, *sides), Obstacles(0, tuple(obstacles)))


def lane_change(v=20.0):
    """Return a change of 3.5 m over 30 m, with an obstacle that cuts 0.1 m into the path."""
    X = np.arange(0.0, 260.0, 0.5)
    u = np.clip((X - 45) / 30, 0, 1)
    Y = 3.5 * (10 * u**3 - 15 * u**4 + 6 * u**5)
    sides = [np.array([[-50.0, y], [350.0, y]]) for y in (6.0, -2.5)]
    obstacle = Obstacle(1, 72.0, 1.5, 1.0, 0.0, 0.0)
    return Situation(path(X, Y, v), RoadEdges(0, *sides), Obstacles(0, (obstacle,)))


def scene(situation):
    """Return the scene of a situation; its obstacles keep their velocity."""
    known = tuple(PredictedObstacle(*o) for o in situation.obstacles.items)
    return Scene(
        reference_path.build(situation.reference),
        road_edges.build(situation.edges),
        situation.obstacles._replace(items=known),
    )


def set_inputs(controller, situation):
    assert controller.set_reference(situation.reference) == ''
    assert controller.set_edges(situation.edges) == ''
    controller.set_obstacles(situation.obstacles)
    controller.reset(REST)
    # of earlier tests: the controller is shared
    controller.memory = controller.memory._replace(rejections={})
    return controller


def tick(controller, x, **inputs):
    """Return command, prediction and why of one step."""
    record = controller.step(TickInputs(x, **inputs))
    return record.command, *controller.report(record)


def rolling(v=20.0, stamp_ns=0, X=0.0, Y=0.0, psi=0.0, vy=0.0, r=0.0):
    return VehicleState(stamp_ns, X, Y, psi, v, vy, r)


@cache
def _motion(structure):
    """Return (x, u, car) -> the state a tick later, by short Runge-Kutta 4 steps of the model."""
    f, h = single_track.rates(structure), TICK_S / FINE_STEPS
    x, u, car = f.sx_in()
    end = x
    for _ in range(FINE_STEPS):
        k1 = f(end, u, car)
        k2 = f(end + h / 2 * k1, u, car)
        k3 = f(end + h / 2 * k2, u, car)
        k4 = f(end + h * k3, u, car)
        end += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function('motion', [x, u, car], [end])


def make_car(car):
    """Return the prediction model over one tick, integrated finely: (state, command) -> state."""
    motion = _motion(single_track.structure(car))

    def tick(x, command):
        x = State(*x)
        force = command.Fxf + command.Fxr
        u = Input(
            d_delta=(command.delta - x.delta) / TICK_S,
            d_Fx=(force - x.Fx) / TICK_S,
            lambda_b=command.Fxf / force if force < 0 else 0.5,
            slack=0.0,
        )
        return State(*motion(x, u, car).full().ravel().tolist())

    return tick


class Drive(NamedTuple):
    """States, commands and reports of a closed loop, one per tick."""

    X: np.ndarray  # (n, nx)
    commands: list
    whys: list

    @property
    def states(self):
        return State(*self.X.T)


def drive(controller, ticks, x=None):
    """Drive the prediction model with the controller."""
    x = x or State(0.0, 0.0, 0.0, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    advance = make_car(controller.car)
    rows, commands, whys = [], [], []
    for k in range(ticks):
        stamp = k * round(TICK_S * 1e9)
        command, _, why = tick(controller, VehicleState(stamp, *x[:6]))
        rows.append(x)
        commands.append(command)
        whys.append(why)
        x = advance(x, command)
    return Drive(np.array(rows), commands, whys)


class ModifiedSolver:
    """A solver whose solutions are modified; it records its guesses, solutions and time limits.

    The limits are noted only: the machine may be busy.
    """

    def __init__(self, inner, modify=lambda solution: solution, clock=None, takes_s=0.0):
        self.inner, self.modify, self.clock, self.takes_s = inner, modify, clock, takes_s
        self.guesses, self.solutions, self.limits_s, self.limit_s = [], [], [], None

    def solve(self, x0, P, bounds, guess):
        self.P = P
        self.guesses.append(guess)
        self.limits_s.append(self.limit_s)
        if self.clock:
            self.clock.now += self.takes_s
        self.solutions.append(self.modify(self.inner.solve(x0, P, bounds, guess)))
        return self.solutions[-1]

    def set_time_limit(self, seconds):
        self.limit_s = seconds
        self.inner.set_time_limit(10.0)


class Clock:
    """A clock that advances only when a test sets `now`."""

    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture(scope='session')
def params():
    return load()[0]


@pytest.fixture(scope='session')
def vehicle():
    return load()[1]


@pytest.fixture(scope='session')
def car(params, vehicle):
    return stage_parameters.car(params, vehicle)


@pytest.fixture(scope='session')
def shared_controller(params, vehicle):
    """Return one controller for all tests of this process; `set_inputs` resets it."""
    return Controller(params, vehicle)


@pytest.fixture(scope='session')
def baseline_controller():
    """Return one controller with the baseline's problem for all tests of this process."""
    return Controller(*load('frenet'))


@pytest.fixture
def controller(shared_controller):
    """Return the controller at the start of a lane change."""
    return set_inputs(shared_controller, lane_change())


@pytest.fixture
def modify_solver(controller, monkeypatch):
    """Return a function that modifies the solver of the controller."""
    genuine = controller.parts.solvers.followed

    def replace(modify=lambda solution: solution):
        solver = ModifiedSolver(genuine, modify)
        monkeypatch.setattr(controller.parts.solvers, 'followed', solver)
        return solver

    return replace


@pytest.fixture
def realtime():
    """Return a controller in realtime whose solver takes 15 ms on a simulated clock."""
    params, vehicle = load(
        solver__time_limit_s=10.0, solver__patience_s=10.0, delay__computing_s=0.008
    )
    clock = Clock()
    controller = set_inputs(Controller(params, vehicle, True, clock), straight())
    controller.parts.solvers.followed = ModifiedSolver(
        controller.parts.solvers.followed, clock=clock, takes_s=0.015
    )
    return controller


@pytest.fixture(scope='session')
def world():
    """Return the helpers of this file under one name: test modules cannot import it."""
    helpers = load, path, straight, lane_change, scene, set_inputs, rolling, tick, drive, make_car
    names = {helper.__name__: helper for helper in (*helpers, ModifiedSolver, Clock)}
    return SimpleNamespace(**names, ESTIMATE=ESTIMATE, REST=REST)
