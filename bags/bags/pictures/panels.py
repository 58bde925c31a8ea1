"""The panels of the comparison against the station: each draws every run on one pair of axes.

They follow the paper's double-lane-change figure: distances to edges and obstacles, velocity,
sideslip angle, road-wheel angle, longitudinal force, and the G-G diagram, under its captions.
"""

from typing import NamedTuple

import numpy as np

from bags.pictures import closest, palette
from bags.verdict.drive import Drive
from bags.verdict.judge import Series

GRAVITY = 9.81  # m/s^2
EVERY = 10  # of the 1 kHz samples one in this many is drawn
FAR_M = 5.0  # distances beyond this are safe, and not drawn
LEAST_SPAN_MPS = 2.0  # a tenth of a metre per second must not look like braking
LEAST_MARGIN_M = 0.1  # of stations: of a car that stands there is one
KILO = 1e3
STATION = 'station along the coarse path [m]'


class Run(NamedTuple):
    """One drive with what the judge made of it, and its look."""

    name: str
    drive: Drive
    series: Series
    colour: str

    @property
    def line(self):
        """Keyword arguments of the run's curves."""
        return {'color': self.colour, 'linestyle': palette.dashes(self.name)}


def v2e(ax, runs):
    """Distance between the vehicle circle and each road edge (D_V2E)."""
    for run in runs:
        for side, shade in (('right', 1.0), ('left', 0.45)):
            gap = run.series.v2e[side]
            _curve(ax, run, gap, alpha=shade)
            _mark(ax, run, np.nanargmin(gap), gap)
    closest.unsafe(ax, max(run.drive.facts.safe_edge for run in runs))
    _distance_limits(ax, [gap for run in runs for gap in run.series.v2e.values()])
    note(ax, 'strong: right edge, pale: left')
    _along(ax, runs)
    ax.set(ylabel='$D_{V2E}$ [m]', title='Vehicle-to-edge distance')


def v2o(ax, runs):
    """Distance between the vehicle circle and each obstacle (D_V2O)."""
    near = False
    for run in runs:
        for gap in run.series.v2o.values():
            _curve(ax, run, np.where(gap < 2 * FAR_M, gap, np.nan))
            if np.any(gap < FAR_M):
                _mark(ax, run, np.nanargmin(gap), gap)
                near = True
    if not near:
        text = f'no obstacle within {FAR_M:g} m'
        ax.text(0.5, 0.6, text, transform=ax.transAxes, ha='center', color=palette.QUIET)
    closest.unsafe(ax, max(run.drive.facts.safe_obstacle for run in runs))
    _distance_limits(ax, [gap for run in runs for gap in run.series.v2o.values()])
    _along(ax, runs)
    closest.insets(ax, runs)
    ax.set(ylabel='$D_{V2O}$ [m]', title='Vehicle-to-obstacle distance')


def velocity(ax, runs):
    """Longitudinal velocity."""
    for run in runs:
        _curve(ax, run, run.drive.motion.vx)
    low, high = ax.get_ylim()
    spare = max(0.0, LEAST_SPAN_MPS - (high - low)) / 2
    ax.set_ylim(low - spare, high + spare)
    _along(ax, runs)
    ax.set(ylabel='$v_x$ [m/s]', title='Longitudinal velocity')


def sideslip(ax, runs):
    """Sideslip angle at the centre of gravity."""
    for run in runs:
        angle = np.degrees(run.series.sideslip)
        _curve(ax, run, angle)
        if not np.all(np.isnan(angle)):
            _mark(ax, run, np.nanargmax(np.abs(angle)), angle)
    _along(ax, runs)
    ax.set(ylabel='$\\beta$ [deg]', title='Vehicle sideslip angle')


def steer(ax, runs):
    """Road-wheel angle behind the actuator."""
    for run in runs:
        inputs = run.drive.inputs
        station = _station_at(run, inputs.stamp_ns[::EVERY])
        ax.plot(station, np.degrees(inputs.steer[::EVERY]), **run.line)
    _along(ax, runs)
    ax.set(ylabel='$\\delta$ [deg]', title='Road-wheel angle')


def force(ax, runs):
    """Longitudinal force of both axles behind the actuator."""
    for run in runs:
        inputs = run.drive.inputs
        station = _station_at(run, inputs.stamp_ns[::EVERY])
        ax.plot(station, inputs.force[::EVERY] / KILO, **run.line)
    ax.axhline(0.0, color=palette.EDGE, lw=0.6, zorder=1)
    _along(ax, runs)
    ax.set(ylabel='$F_x$ [kN], braking negative', title='Longitudinal force input')


def gg(ax, runs):
    """Accelerations at the centre of gravity within the friction circle."""
    measured = [run.drive.accelerations for run in runs]
    for run, acc in zip(runs, measured):
        ax.plot(acc.ay, acc.ax, **{**run.line, 'linewidth': 1.0, 'alpha': 0.85})
    angle = np.linspace(0.0, 2.0 * np.pi, 181)
    radius = GRAVITY * max(run.drive.facts.friction for run in runs)
    ax.plot(radius * np.cos(angle), radius * np.sin(angle), color=palette.EDGE, lw=1.0, ls=':')
    note(ax, 'dotted: friction circle')
    reach = 1.08 * max(radius, *(np.abs([*acc.ax, *acc.ay]).max(initial=0.0) for acc in measured))
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach))
    ax.set_aspect('equal', adjustable='box')
    # its title stays level with those of its neighbours
    ax.set_anchor('N')
    ax.set(xlabel='$a_y$ [m/s²], left positive', ylabel='$a_x$ [m/s²]', title='G-G diagram')


def _curve(ax, run, values, **look):
    ax.plot(run.series.station[::EVERY], values[::EVERY], **{**run.line, **look})


def _mark(ax, run, k, values):
    """Put a dot on the extreme that the metrics report."""
    point = (run.series.station[k], values[k])
    ax.plot(*point, 'o', ms=4.5, color=run.colour, mec='white', mew=0.8, zorder=5)


def _station_at(run, stamp_ns):
    return np.interp(stamp_ns, run.drive.motion.stamp_ns, run.series.station)


def _along(ax, runs):
    """Show the same stations in every panel."""
    low = min(run.series.station.min() for run in runs)
    high = max(run.series.station.max() for run in runs)
    margin = max(0.02 * (high - low), LEAST_MARGIN_M)
    ax.set(xlim=(low - margin, high + margin), xlabel=STATION)


def _distance_limits(ax, gaps):
    """Show what is near; half a metre of room below the smallest distance."""
    low = min([0.0, *(np.nanmin(gap) for gap in gaps if not np.all(np.isnan(gap)))])
    ax.set_ylim(low - 0.5, FAR_M)


def note(ax, text):
    """Say something small about a panel, above its right corner."""
    ax.annotate(
        text,
        (1.0, 1.0),
        (0, 7),
        xycoords='axes fraction',
        textcoords='offset points',
        ha='right',
        va='bottom',
        fontsize=7.5,
        color=palette.QUIET,
    )
