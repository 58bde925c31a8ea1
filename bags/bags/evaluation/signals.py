"""Derived signals of a run on the time base of its odometry: a column each, in plain numpy.

    @signal('rad')
    def sideslip_rad(run):
        '''Sideslip angle at the centre of gravity.'''
        return run.series.sideslip

adds one: the name of the function is the column and ends with its unit, the docstring is its
meaning. A function that returns a dictionary has a column per key, `v2o_m.1`, and its decorator
says what the keys are, `@signal('m', by='obstacle id', such_as='1')`; one that returns None, for
want of a topic, has none. Distances and angles are those of `series`, by which the metrics judge.
Positive is to the left (ISO 8855), forces and angles are those of base_link.
"""

import inspect
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from bags.evaluation.controller_log import report_numbers
from bags.evaluation.metrics.driving import GRAVITY
from bags.evaluation.metrics.registry import EvaluatedDrive
from msgs_yaml.types import WHEELS

ACTUATORS, WHEEL_STATES = '/vehicle/actuators', '/vehicle/wheels'
COMMAND, WHY = '/controller/command', '/controller/why'
AXLES = ('front', 'rear')
MEMBER = '.'  # between a column and its member, an obstacle id or a wheel


class Signal(NamedTuple):
    """One derived signal."""

    function: Callable[[EvaluatedDrive], Any]
    name: str  # the column, or what is before the member in its columns
    unit: str
    meaning: str  # the docstring as one line; of several columns also how they are called


SIGNALS: dict[str, Signal] = {}  # in the order in which they are defined


def signal(unit: str, by: str = '', such_as: str = '') -> Callable:
    """Return a decorator that registers a signal under the name of its function.

    `by` says what the keys of several columns are, `such_as` is one of them. Raises ValueError for
    a name that is registered.
    """

    def register(function):
        name = function.__name__
        if name in SIGNALS:
            raise ValueError(f'the signal {name} is registered already')
        meaning = ' '.join(inspect.getdoc(function).split())
        if by:
            meaning += f' A column per {by}, as {name}{MEMBER}{such_as}.'
        SIGNALS[name] = Signal(function, name, unit, meaning)
        return function

    return register


def compute_signals(run: EvaluatedDrive) -> dict[str, np.ndarray]:
    """Return every signal (n,) by column; columns that want an unrecorded topic are absent."""
    columns = {}
    for name, entry in SIGNALS.items():
        values = entry.function(run)
        if isinstance(values, Mapping):
            columns |= {f'{name}{MEMBER}{key}': member for key, member in values.items()}
        elif values is not None:
            columns[name] = values
    return columns


def resample(run: EvaluatedDrive, topic: str, column: str) -> np.ndarray | None:
    """Return a column of a topic at the time base, linear in between; None without the topic.

    Shape (n,), or (n, 4) of a column of the wheels; not-a-number outside of the recorded time.
    """
    if topic not in run.tables:
        return None
    table = run.tables[topic]
    return interpolate(run.stamp_ns, table.stamp_ns, getattr(table, column))


def interpolate(at_ns: np.ndarray, stamp_ns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values (m,) or (m, k) of stamps (m,) at other stamps (n,), linear in between.

    Not-a-number before the first and after the last.
    """
    if values.ndim == 2:
        return np.column_stack([interpolate(at_ns, stamp_ns, column) for column in values.T])
    order = np.argsort(stamp_ns, kind='stable')
    return np.interp(at_ns, stamp_ns[order], values[order], left=np.nan, right=np.nan)


@signal('m')
def station_m(run):
    """Distance along the coarse path, of the point of it that is nearest to the car."""
    return run.series.station


@signal('m')
def contouring_m(run):
    """Distance from the coarse path, positive to its left."""
    return run.series.contouring


@signal('m/s')
def speed_mps(run):
    """Speed over ground."""
    return run.series.speed


@signal('rad')
def sideslip_rad(run):
    """Sideslip angle at the centre of gravity, atan2(vy, vx); not-a-number below 3 m/s."""
    return run.series.sideslip


@signal('m', by='obstacle id', such_as='1')
def v2o_m(run):
    """Distance D_V2O (eq. 3) of the car's circles to each obstacle; not-a-number while absent."""
    return run.series.v2o


@signal('m', by='edge', such_as='left')
def v2e_m(run):
    """Distance D_V2E (eq. 4) of the car's circles to each road edge; negative beyond it."""
    return run.series.v2e


@signal('m', by='obstacle id', such_as='1')
def outline_gap_m(run):
    """Gap from the true outline of the car to each obstacle; negative is the depth of overlap."""
    return run.series.outline_gaps


@signal('m/s²')
def ax_mps2(run):
    """Measured longitudinal acceleration at the centre of gravity, without gravity."""
    return _measured(run).get('ax')


@signal('m/s²')
def ay_mps2(run):
    """Measured lateral acceleration at the centre of gravity, positive to the left."""
    return _measured(run).get('ay')


@signal('-')
def friction_use(run):
    """Measured acceleration over µg, of the tyres that the controller believes in."""
    measured = _measured(run)
    if not measured:
        return None
    return np.hypot(measured['ax'], measured['ay']) / (run.drive.facts.friction * GRAVITY)


@signal('-', by='axle', such_as='front')
def model_friction_use(run):
    """Share of the tyre force of each axle that the controller's model uses, of the last tick."""
    if WHY not in run.tables:
        return None
    why = run.tables[WHY]
    last = np.searchsorted(why.stamp_ns, run.stamp_ns, side='right') - 1
    use = {axle: report_numbers(why.values, f'friction.{axle}') for axle in AXLES}
    return {axle: np.where(last < 0, np.nan, values[last]) for axle, values in use.items()}


@signal('-', by='wheel', such_as='fl')
def tyre_use(run):
    """Horizontal over vertical force of each tyre: the coefficient of friction that it uses."""
    parts = ('force_x_n', 'force_y_n', 'load_n')
    forward, leftward, load = (resample(run, WHEEL_STATES, name) for name in parts)
    if load is None:
        return None
    # a wheel in the air uses none
    use = np.hypot(forward, leftward) / np.where(load > 0.0, load, np.nan)
    return dict(zip(WHEELS, use.T))


@signal('rad')
def steer_rad(run):
    """Road-wheel angle of the actuator, positive to the left."""
    return resample(run, ACTUATORS, 'steer_rad')


@signal('rad')
def steer_command_rad(run):
    """Commanded road-wheel angle: linear from one set-point to the next, as they fall due."""
    return _commanded(run, 'steer_rad')


@signal('N')
def front_x_n(run):
    """Longitudinal force of the actuators at the front axle, braking negative."""
    return resample(run, ACTUATORS, 'front_x_n')


@signal('N')
def front_x_command_n(run):
    """Commanded longitudinal force at the front axle, linear between set-points."""
    return _commanded(run, 'front_x_n')


@signal('N')
def rear_x_n(run):
    """Longitudinal force of the actuators at the rear axle, braking negative."""
    return resample(run, ACTUATORS, 'rear_x_n')


@signal('N')
def rear_x_command_n(run):
    """Commanded longitudinal force at the rear axle, linear between set-points."""
    return _commanded(run, 'rear_x_n')


def _measured(run):
    """Return the accelerations (n,) [m/s^2] by axis; {} where none was measured."""
    measured = run.drive.accelerations
    if not measured.stamp_ns.size:
        return {}
    stamp_ns = measured.stamp_ns
    axes = {'ax': measured.ax, 'ay': measured.ay}
    return {name: interpolate(run.stamp_ns, stamp_ns, axis) for name, axis in axes.items()}


def _commanded(run, column):
    """Return a set-point (n,) over time: a command is due one period after its state."""
    if COMMAND not in run.tables:
        return None
    command = run.tables[COMMAND]
    due_ns = command.stamp_ns + run.drive.facts.tick_ns
    return interpolate(run.stamp_ns, due_ns, getattr(command, column))
