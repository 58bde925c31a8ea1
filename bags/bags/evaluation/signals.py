"""Derived signals of a run on the time base of its odometry: a column each, in plain numpy.

A row of SIGNALS adds one. Its key is the column and ends with its unit. Values that are a
dictionary are a column per key, `v2o_m.1`, and `keys` says what the keys are and names one; None,
for want of a topic, is no column. Distances and angles are those of `Series`, by which the metrics
judge. Positive is to the left (ISO 8855), forces and angles are those of base_link.
"""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from bags.evaluation.drive import COMMAND, WHY, report_numbers
from bags.evaluation.metrics.driving import GRAVITY
from bags.evaluation.metrics.registry import EvaluatedDrive
from msgs_yaml.types import WHEELS

MEMBER = '.'  # between a column and its member, an obstacle id or a wheel


def compute_signals(run: EvaluatedDrive) -> dict[str, np.ndarray]:
    """Return every signal (n,) by column; columns that want an unrecorded topic are absent."""
    columns = {}
    for name, entry in SIGNALS.items():
        values = entry.values(run)
        if isinstance(values, Mapping):
            columns |= {f'{name}{MEMBER}{key}': member for key, member in values.items()}
        elif values is not None:
            columns[name] = values
    return columns


def resample(run: EvaluatedDrive, topic: str, column: str) -> np.ndarray | None:
    """Return a column of a topic at the time base, linear in between; None without the topic.

    Shape (n,), or (n, 4) of a column of the wheels; not-a-number outside of the recorded time. A
    command is due one period after its state.
    """
    if topic not in run.tables:
        return None
    table = run.tables[topic]
    due_ns = run.drive.facts.tick_ns if topic == COMMAND else 0
    return interpolate(run.stamp_ns, table.stamp_ns + due_ns, getattr(table, column))


def interpolate(at_ns: np.ndarray, stamp_ns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return values (m,) or (m, k) of stamps (m,) at other stamps (n,), linear in between.

    Not-a-number before the first and after the last.
    """
    if values.ndim == 2:
        return np.column_stack([interpolate(at_ns, stamp_ns, column) for column in values.T])
    order = np.argsort(stamp_ns, kind='stable')
    return np.interp(at_ns, stamp_ns[order], values[order], left=np.nan, right=np.nan)


def measured(run: EvaluatedDrive, axis: str) -> np.ndarray | None:
    """Return the acceleration (n,) [m/s^2] along `ax` or `ay`; None where none was measured."""
    table = run.drive.accelerations
    if not table.stamp_ns.size:
        return None
    return interpolate(run.stamp_ns, table.stamp_ns, getattr(table, axis))


def friction_use(run: EvaluatedDrive) -> np.ndarray | None:
    """Return the signal of this name."""
    ax, ay = measured(run, 'ax'), measured(run, 'ay')
    return None if ax is None else np.hypot(ax, ay) / (run.drive.facts.friction * GRAVITY)


def _model_friction_use(run):
    if WHY not in run.tables:
        return None
    why = run.tables[WHY]
    last = np.searchsorted(why.stamp_ns, run.stamp_ns, side='right') - 1
    use = {axle: report_numbers(why.values, f'friction.{axle}') for axle in ('front', 'rear')}
    return {axle: np.where(last < 0, np.nan, values[last]) for axle, values in use.items()}


def _tyre_use(run):
    parts = ('force_x_n', 'force_y_n', 'load_n')
    forward, leftward, load = (resample(run, '/vehicle/wheels', name) for name in parts)
    if load is None:
        return None
    # a wheel in the air uses none
    use = np.hypot(forward, leftward) / np.where(load > 0.0, load, np.nan)
    return dict(zip(WHEELS, use.T))


class Signal(NamedTuple):
    """One derived signal."""

    unit: str
    meaning: str  # in one sentence
    values: Callable[[EvaluatedDrive], Any]
    keys: tuple[str, str] = ('', '')  # of several columns: what their keys are, and one of them


ACTUATED = partial(resample, topic='/vehicle/actuators')
COMMANDED = partial(resample, topic=COMMAND)
SIGNALS: dict[str, Signal] = {
    'station_m': Signal(
        'm',
        'Distance along the coarse path, of the point of it that is nearest to the car.',
        lambda run: run.series.station,
    ),
    'contouring_m': Signal(
        'm',
        'Distance from the coarse path, positive to its left.',
        lambda run: run.series.contouring,
    ),
    'speed_mps': Signal('m/s', 'Speed over ground.', lambda run: run.series.speed),
    'sideslip_rad': Signal(
        'rad',
        'Sideslip angle at the centre of gravity, atan2(vy, vx); not-a-number below 3 m/s.',
        lambda run: run.series.sideslip,
    ),
    'v2o_m': Signal(
        'm',
        "Distance D_V2O (eq. 3) of the car's circles to each obstacle; not-a-number while absent.",
        lambda run: run.series.v2o,
        ('obstacle id', '1'),
    ),
    'v2e_m': Signal(
        'm',
        "Distance D_V2E (eq. 4) of the car's circles to each road edge; negative beyond it.",
        lambda run: run.series.v2e,
        ('edge', 'left'),
    ),
    'outline_gap_m': Signal(
        'm',
        'Gap from the true outline of the car to each obstacle; negative is the depth of overlap.',
        lambda run: run.series.outline_gaps,
        ('obstacle id', '1'),
    ),
    'ax_mps2': Signal(
        'm/s²',
        'Measured longitudinal acceleration at the centre of gravity, without gravity.',
        partial(measured, axis='ax'),
    ),
    'ay_mps2': Signal(
        'm/s²',
        'Measured lateral acceleration at the centre of gravity, positive to the left.',
        partial(measured, axis='ay'),
    ),
    'friction_use': Signal(
        '-',
        'Measured acceleration over µg, of the tyres that the controller believes in.',
        friction_use,
    ),
    'model_friction_use': Signal(
        '-',
        "Share of the tyre force of each axle that the controller's model uses, of the last tick.",
        _model_friction_use,
        ('axle', 'front'),
    ),
    'tyre_use': Signal(
        '-',
        'Horizontal over vertical force of each tyre: the coefficient of friction that it uses.',
        _tyre_use,
        ('wheel', 'fl'),
    ),
    'steer_rad': Signal(
        'rad',
        'Road-wheel angle of the actuator, positive to the left.',
        partial(ACTUATED, column='steer_rad'),
    ),
    'steer_command_rad': Signal(
        'rad',
        'Commanded road-wheel angle: linear from one set-point to the next, as they fall due.',
        partial(COMMANDED, column='steer_rad'),
    ),
    'front_x_n': Signal(
        'N',
        'Longitudinal force of the actuators at the front axle, braking negative.',
        partial(ACTUATED, column='front_x_n'),
    ),
    'front_x_command_n': Signal(
        'N',
        'Commanded longitudinal force at the front axle, linear between set-points.',
        partial(COMMANDED, column='front_x_n'),
    ),
    'rear_x_n': Signal(
        'N',
        'Longitudinal force of the actuators at the rear axle, braking negative.',
        partial(ACTUATED, column='rear_x_n'),
    ),
    'rear_x_command_n': Signal(
        'N',
        'Commanded longitudinal force at the rear axle, linear between set-points.',
        partial(COMMANDED, column='rear_x_n'),
    ),
}
