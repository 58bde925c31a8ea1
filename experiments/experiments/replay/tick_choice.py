"""Which tick of a recording is meant: by a time, a station, or what happens there."""

from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from bags.evaluation.drive import drive_from_columns
from bags.evaluation.metrics import outcome
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.storage import read
from bags.storage.invalid_messages import drop_invalid
from experiments.replay import recorded_ticks
from experiments.tick_events import EVENTS, LEAD_S, LOSS

NS = 1e-9  # s


class ChosenTick(NamedTuple):
    """A tick and where it is."""

    number: int
    t: float  # s since the first tick
    station: float  # m
    because: str  # what is there, '' for a tick that was named by time or station

    def __str__(self) -> str:
        because = f': {self.because}' if self.because else ''
        return f'tick {self.number} at {self.t:.2f} s, station {self.station:.1f} m{because}'


def choose(
    bag: read.Bag,
    *,
    time: float | None = None,
    station: float | None = None,
    event: str | None = None,
) -> ChosenTick:
    """Return the tick that is meant: the last one that is not behind the moment.

    Given is one of: `time` [s] since the first tick, `station` [m] along the reference, `event`,
    one of EVENTS. Raises BagError for a moment that the recording does not have.
    """
    stamps = np.array([tick.stamp_ns for tick in recorded_ticks.read_ticks(bag)])
    t = (stamps - stamps[0]) * NS
    columns = read.columns(drop_invalid(bag), recorded_ticks.NEEDED)
    run = EvaluatedDrive(drive_from_columns(columns, bag.run_info, str(bag.path)))
    stations, because = run.station_at(stamps), ''

    def last_until(stamp_ns):
        return max(int(np.searchsorted(stamps, stamp_ns, side='right')) - 1, 0)

    if time is not None:
        _check(bag, 'time', time, 0.0, t[-1], 's')
        # a time as text may be a rounding below that of its tick
        number = int(np.searchsorted(t, time + 1e-6, side='right')) - 1
    elif station is not None:
        _check(bag, 'station', station, stations[0], stations.max(), 'm')
        number = max(int(np.argmax(stations > station)) - 1, 0)
    elif event == 'fallback':
        (rows,) = np.nonzero(run.drive.ticks.fallback)
        if not rows.size:
            raise BagError(f'{bag.path}: every tick followed a fresh plan')
        number, because = int(rows[0]), EVENTS[event]
    elif event == LOSS:
        losses = outcome.find_losses(run)
        if not losses:
            raise BagError(
                f'{bag.path}: the car neither collided nor left the road nor slid; --at closest '
                'shows the least distance to an obstacle'
            )
        row, what = losses[0]
        number = last_until(run.stamp_ns[row] - LEAD_S / NS)
        lead = (run.stamp_ns[row] - stamps[number]) * NS
        because = f'{lead:.1f} s before station {run.series.station[row]:.0f} m, where it {what}'
    else:
        row, because = _extreme(bag, event, run.series)
        number = last_until(run.stamp_ns[row])
    return ChosenTick(number, float(t[number]), float(stations[number]), because)


def _check(bag, what, value, low, high, unit):
    if not low <= value <= high:
        raise BagError(
            f'{bag.path}: no tick at {what} {value:g} {unit}; it has {low:g} to {high:g} {unit}'
        )


def _extreme(bag, event, series):
    """Return the row of the series at an event, and what is there."""
    if event == 'sideslip':
        angle = np.degrees(np.abs(np.nan_to_num(series.sideslip)))
        row = int(np.argmax(angle))
        return row, f'{EVENTS[event]}, {angle[row]:.1f} deg'
    gaps = series.v2o if event == 'closest' else series.v2e
    known = {name: gap for name, gap in gaps.items() if np.any(np.isfinite(gap))}
    if not known:
        raise BagError(f'{bag.path}: there is no obstacle')
    name = min(known, key=lambda name: np.nanmin(known[name]))
    row = int(np.nanargmin(known[name]))
    which = f'to obstacle {name}' if event == 'closest' else f'to the {name} edge'
    return row, f'least distance {which}, {known[name][row]:.2f} m'
