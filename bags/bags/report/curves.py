"""What the panels of the report show: quantities of one run over time, in the unit of a reader."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from bags.pictures.panels import FAR_M, KILO, Run
from bags.report.account import Account
from bags.verdict.drive import Facts

SOLID, DASHED = 'solid', 'dashed'


class Curve(NamedTuple):
    """One line of a panel."""

    label: str  # what tells it from the other lines of the same run; '' where there is one
    dash: str
    stamp_ns: np.ndarray  # (n,)
    values: np.ndarray  # (n,)


class Panel(NamedTuple):
    """One pair of axes against time or station."""

    name: str  # also the id of its element on the page
    title: str
    axis: str  # label of the vertical axis, with its unit
    curves: Callable[[Run, Account], Iterable[Curve]]
    # of the facts of a run: the distance below which is unsafe; None where that has no meaning
    unsafe: Callable[[Facts], float] | None = None


def _speed(run, _):
    yield Curve('', SOLID, run.drive.motion.stamp_ns, run.drive.motion.vx)


def _steer(run, _):
    yield Curve('', SOLID, run.drive.inputs.stamp_ns, np.degrees(run.drive.inputs.steer))


def _force(run, _):
    yield Curve('', SOLID, run.drive.inputs.stamp_ns, run.drive.inputs.force / KILO)


def _sideslip(run, _):
    yield Curve('', SOLID, run.drive.motion.stamp_ns, np.degrees(run.series.sideslip))


def _lateral(run, _):
    yield Curve('', SOLID, run.drive.accelerations.stamp_ns, run.drive.accelerations.ay)


def _contouring(run, _):
    yield Curve('', SOLID, run.drive.motion.stamp_ns, run.series.contouring)


def _v2o(run, _):
    """The nearest obstacle only: near both, the lines of three runs would be a tangle."""
    gaps = list(run.series.v2o.values())
    if gaps:
        nearest = np.fmin.reduce(gaps)
        near = np.where(nearest < FAR_M, nearest, np.nan)
        yield Curve('', SOLID, run.drive.motion.stamp_ns, near)


def _v2e(run, _):
    for side, dash in (('left', DASHED), ('right', SOLID)):
        yield Curve(side, dash, run.drive.motion.stamp_ns, run.series.v2e[side])


def _friction_use(_, account):
    for axle, dash in (('front', SOLID), ('rear', DASHED)):
        if account.said:
            use = account.said[f'friction.{axle}']
            yield Curve(axle, dash, account.answered_ns, use)


def _solve_time(_, account):
    if account.said:
        yield Curve('', SOLID, account.answered_ns, account.said['time.solve_ms'])


PANELS = (
    Panel('v2o', 'Distance to the nearest obstacle', 'D_V2O [m]', _v2o, lambda r: r.safe_obstacle),
    Panel('v2e', 'Distance to the road edges', 'D_V2E [m]', _v2e, lambda r: r.safe_edge),
    Panel('contouring', 'Distance from the coarse path', 'left positive [m]', _contouring),
    Panel('velocity', 'Longitudinal velocity', 'v_x [m/s]', _speed),
    Panel('sideslip', 'Sideslip angle', 'β [deg]', _sideslip),
    Panel('lateral', 'Lateral acceleration', 'a_y [m/s²]', _lateral),
    Panel('steer', 'Road-wheel angle', 'δ [deg]', _steer),
    Panel('force', 'Longitudinal force', 'F_x [kN]', _force),
    Panel('friction', 'Friction use, as the controller sees it', 'F / µF_z', _friction_use),
    Panel('solve', 'Solve time per tick', '[ms]', _solve_time),
)
