"""Drives of the plant that are measured and estimated, for the tests of the estimator."""

from functools import cache

import numpy as np
from drives import drive, load

from experiments import estimation
from mpcc_controller import car_file
from msgs_yaml.types import Gnss
from node_runtime import node_parameters
from node_runtime import parameters as yaml_parameters
from state_estimator import estimators
from state_estimator.parameters import EstimatorParams
from vehicle_plant import parameters
from vehicle_plant.initial_state import Start
from vehicle_plant.sensors import SensorParams, Sensors
from vehicle_plant.simulator import Simulator
from vehicle_plant.state import join_trajectories

START = Start(3.0, -2.0, 0.4, 20.0)
STATES = ('X', 'Y', 'psi', 'vx', 'vy', 'r')


@cache
def car():
    """Return the car as the estimator knows it."""
    return estimation.vehicle(car_file.read('car.yaml'), load().car)


@cache
def grade(name='automotive'):
    """Return the errors of sensors of a grade."""
    return yaml_parameters.load(SensorParams, parameters.config_file(f'sensors_{name}.yaml'))


def params(name='automotive', **given):
    """Return the parameters of the estimator for sensors of a grade."""
    known = estimation.known_values(grade(name), 1.0, car()) | {'yaw_rad': START.psi}
    defaults = node_parameters.find_config('state_estimator', 'estimator.yaml')
    return node_parameters.resolve(EstimatorParams, defaults, {**known, **given})[0]


@cache
def track(amplitude=0.05, omega=3.0, brake_n=0.0, seconds=6.0, friction=1.0, stops=False):
    """Return a drive of steering to and fro, then of braking while it steers."""

    def law(t, car):
        vx = car.state.vx
        if stops:
            force = -4000.0 if vx > 0.2 else -2000.0
        else:
            force = -brake_n if t > 0.5 * seconds and vx > 6.0 else 400.0
        delta = amplitude * np.sin(omega * t) * (vx > 6.0)
        return delta, 0.6 * min(force, 0.0), 0.4 * min(force, 0.0) + max(force, 0.0)

    start = Simulator(load(), friction, START).now
    return join_trajectories([start, drive(law, seconds, START, friction=friction)])


def readings(driven, name='automotive', seed=1):
    """Return the messages of a drive in order of arrival."""
    first = driven.where(np.arange(len(driven.rows)) == 0)
    return Sensors(grade(name), load().car, seed, first).measure(driven)


def estimate(messages, given=None):
    """Return the estimator after the messages, and what it returned."""
    estimator = estimators.create(given or params())
    results = [estimator.update(message.value) for message in messages]
    return estimator, [result for result in results if result]


def errors(driven, results):
    """Return errors of X, Y, psi, vx, vy, r (n, 6) and their standard deviations (n, 6)."""
    stamps = np.array([result.state.stamp_ns for result in results])
    truth = driven.state_columns()
    at = np.searchsorted(driven.stamp_ns, stamps)
    believed = np.array([result.state[1:] for result in results])
    true = np.column_stack([getattr(truth, name)[at] for name in STATES])
    difference = believed - true
    difference[:, 2] = (difference[:, 2] + np.pi) % (2 * np.pi) - np.pi
    sd = np.sqrt(np.array([np.diag(result.covariance) for result in results]))
    return difference, sd


def without(messages, kind, begin_s, end_s):
    """Return the messages without those of a kind between two times [s] after the start."""
    zero = messages[0].value.stamp_ns
    return [
        m for m in messages
        if not (isinstance(m.value, kind) and begin_s <= (m.value.stamp_ns - zero) / 1e9 < end_s)
    ]  # fmt: skip


def moved(messages, begin_s, end_s, by_m):
    """Return the messages with fixes moved sideways between two times [s]."""
    zero = messages[0].value.stamp_ns
    return [
        m._replace(value=m.value._replace(Y=m.value.Y + by_m))
        if isinstance(m.value, Gnss) and begin_s <= (m.value.stamp_ns - zero) / 1e9 < end_s
        else m
        for m in messages
    ]
