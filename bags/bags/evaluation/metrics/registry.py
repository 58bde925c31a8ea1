"""How to add a metric: decorate a function with `@metric`, in any module of this folder.

    @metric('rms lateral acceleration', 'm/s²', 2)
    def rms_lat_acc_mps2(run):
        '''Root mean square of the measured lateral acceleration.'''
        return float(np.sqrt(np.mean(run.drive.accelerations.ay**2)))

The name of the function is the key in comparison.json and comparison.csv; title, unit and
decimals make a row of the printed table and of report.html; the docstring is what
`bags compare --list-metrics` prints. A metric without a title is in JSON and CSV only. Metrics of
a new module are registered when `metrics/__init__.py` imports it.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from bags.evaluation.drive import Drive, Series, compute_series
from bags.storage.columns import Columns


class EvaluatedDrive:
    """One run, evaluated once: the argument of every metric, signal, figure and view.

    drive     its arrays; all samples are finite
    series    distances and angles at every message of the odometry
    tables    by topic, those that were recorded; {} where the drive is all that is known
    run_info  the metadata record `run` as it was recorded, texts by name; likewise
    damage    of a recording: where it is damaged, None for a sound one
    invalid   of a recording: the messages that were left out, `{'invalid_messages': ...}`
    name      what it is called in tables and figures
    look      how its curves are drawn, once `style.assign` gave it one
    """

    drive: Drive
    tables: Mapping[str, Columns] = MappingProxyType({})
    run_info: Mapping[str, str] = MappingProxyType({})
    damage: str | None = None
    invalid: Mapping[str, Any] = MappingProxyType({})
    name: str = ''
    look: Any = None

    def __init__(self, drive: Drive):
        self.drive = drive

    @cached_property
    def series(self) -> Series:
        """Distances and angles of the drive."""
        return compute_series(self.drive)

    @cached_property
    def _values(self) -> dict[Callable, Any]:
        return {}

    def value(self, function: Callable[['EvaluatedDrive'], Any]) -> Any:
        """Return function(self), computed once: so metrics may use each other's values."""
        if function not in self._values:
            self._values[function] = function(self)
        return self._values[function]

    def sent(self, topic: str) -> Sequence[Any]:
        """Return the messages of a topic without numeric columns; none if it was not recorded."""
        return self.tables[topic].values if topic in self.tables else ()

    @property
    def stamp_ns(self) -> np.ndarray:
        """The time base (n,) int64 [ns]: the stamps of the odometry."""
        return self.drive.motion.stamp_ns

    def station_at(self, stamp_ns: np.ndarray) -> np.ndarray:
        """Return the station (n,) [m] at each stamp."""
        return np.interp(stamp_ns, self.stamp_ns, self.series.station)


class Metric(NamedTuple):
    """One metric and how it is shown."""

    function: Callable[[EvaluatedDrive], Any]
    title: str  # of its row in the table; '' without a row
    unit: str
    decimals: int
    good_when: bool | None = None  # of a yes or no: which of both is good
    yes: str = 'yes'  # how a yes is shown; names of other metrics in braces are filled in
    until_spin: bool = False  # whether the value of a car that spun says nothing, and is not shown
    optional: bool = False  # no row where no run has a value
    # of a dictionary, by key: what `{}` in the title stands for, and the value of the paper
    labels: Mapping[str, str] = MappingProxyType({})
    paper: Mapping[str, float] = MappingProxyType({})

    @property
    def name(self) -> str:
        """The key in comparison.json."""
        return self.function.__name__

    @property
    def meaning(self) -> str:
        """The docstring as one line."""
        return ' '.join(inspect.getdoc(self.function).split())


METRICS: dict[str, Metric] = {}  # in the order in which they are defined


def table_metrics() -> list[Metric]:
    """Return the metrics that have rows in the table, in the order of the rows."""
    return [metric for metric in METRICS.values() if metric.title]


def metric(title: str = '', unit: str = '', decimals: int = 0, **shown: Any) -> Callable:
    """Return a decorator that registers a metric under the name of its function.

    `shown` are the other fields of Metric, for how it is shown.

    The function takes an EvaluatedDrive and returns a JSON value: a number, a bool, a text, None,
    a list of overshoots, or a dictionary of numbers, which has a row per key with `{}` in the
    title replaced by the key or its label. Raises ValueError for a name that is registered.
    """

    def register(function):
        name = function.__name__
        if name in METRICS:
            raise ValueError(f'the metric {name} is registered already')
        METRICS[name] = Metric(function, title, unit, decimals, **shown)
        return function

    return register


def flatten(value: Any, name: str = '') -> dict[str, Any]:
    """Return the single values in mappings and lists by dotted name; `name` begins each."""
    if isinstance(value, Mapping):
        members = value.items()
    elif isinstance(value, list):
        members = enumerate(value)
    else:
        return {name: value}
    flat = {}
    for key, member in members:
        flat |= flatten(member, f'{name}.{key}' if name else str(key))
    return flat
