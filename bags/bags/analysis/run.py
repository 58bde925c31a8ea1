"""A run, recorded or simulated: its metrics, tables, derived signals and figure.

    import bags

    run = bags.load('bags/runs/double_lane_change/mpcc')
    run.metrics['min_v2o_m']                       # 0.53
    run.frame('/vehicle/odometry')['vx_mps'].plot()
    run.signals[['station_m', 'sideslip_rad', 'v2o_m.1']]
    run.figure().savefig('mpcc.png')

What is computed is kept: a second access costs nothing.
"""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from bags.analysis import frames
from bags.analysis.metric_values import MetricValues
from bags.errors import BagError, InvalidMessagesWarning
from bags.evaluation import metrics
from bags.evaluation.drive import Drive, drive_from_columns, drop_nonfinite
from bags.evaluation.series import Series, compute_series
from bags.evaluation.signals import EvaluatedRun, compute_signals
from bags.storage import read
from bags.storage.columns import Columns
from bags.storage.invalid_messages import count_invalid, describe_invalid, drop_invalid
from bags.storage.read import STATE
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.strict_yaml import closest
from node_runtime import provenance

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

PARAMETERS = 'parameters'  # the record of the run that holds the parameters of its nodes
NESTED = ('versions', 'machine')  # records that are mappings
NO_SETTINGS: Mapping[str, Any] = MappingProxyType({})


class UnknownTopicError(BagError, KeyError):
    """A run has no message of a topic; the message says of which it has some."""

    def __str__(self) -> str:
        return self.args[0]


class TopicTables(Mapping[str, Columns]):
    """The tables of a run by topic, decoded when they are first asked for."""

    def __init__(self, source: str, topics: Iterable[str], decode: Callable[[str], Columns]):
        self._source, self._decode = source, decode
        known = set(topics)
        self._topics = tuple(topic for topic in frames.FRAMED if topic in known)
        self._tables: dict[str, Columns] = {}

    def __getitem__(self, topic: str) -> Columns:
        if topic not in self._topics:
            raise UnknownTopicError(
                f'{self._source}: no message of {topic!r}{closest(topic, self._topics)}; '
                f'it has {", ".join(self._topics)}'
            )
        if topic not in self._tables:
            self._tables[topic] = self._decode(topic)
        return self._tables[topic]

    def __iter__(self) -> Iterator[str]:
        return iter(self._topics)

    def __len__(self) -> int:
        return len(self._topics)

    def __repr__(self) -> str:
        return f'TopicTables({", ".join(self._topics)})'


class Origin(NamedTuple):
    """Where a run comes from."""

    source: str  # the file of a recording, or what was simulated; it begins errors
    run_info: Mapping[str, str]  # the metadata record `run`, as a recorder writes it
    settings: Mapping[str, Any] = NO_SETTINGS  # what was changed for it, by dotted name
    path: Path | None = None  # of a recording
    faults: tuple[str, ...] = ()  # of a recording: what was left out of it, and why


class Run:
    """One run by one controller. Units and axes are those of `bags.storage.columns`.

    label      what it is called in tables and figures; by default the controller, and the label
               of the recording
    path       of a recording, None of a simulation
    tables     by topic, numpy columns
    settings   what was changed for this run, by dotted name; {} of a recording
    faults     what was left out of a damaged recording, one sentence each
    """

    def __init__(self, tables: TopicTables, origin: Origin, label: str = ''):
        self.tables, self.settings = tables, dict(origin.settings)
        self.source, self.path, self.faults = origin.source, origin.path, origin.faults
        self._run_info = origin.run_info
        named = provenance.run_name(self._run_info) if self.controller else Path(self.source).stem
        self.label = label or named

    @property
    def scenario(self) -> str:
        """The name of the scenario; '' where the recording does not say it."""
        return self._run_info.get('scenario', '')

    @property
    def controller(self) -> str:
        """The name of the controller; '' where the recording does not say it."""
        return self._run_info.get('controller', '')

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics that `frame` and `table` know."""
        return tuple(self.tables)

    @property
    def run_info(self) -> Mapping[str, str]:
        """The metadata record `run` as it was recorded: texts by name."""
        return self._run_info

    @cached_property
    def metadata(self) -> dict[str, Any]:
        """What was recorded about the run besides its parameters: scenario, mode, versions, ...."""
        known = {name: value for name, value in self._run_info.items() if name != PARAMETERS}
        return known | {name: json.loads(known[name]) for name in NESTED if name in known}

    @cached_property
    def parameters(self) -> dict[str, Any]:
        """Every parameter of every node by dotted name, `controller.tolerances.contouring_m`."""
        roles = json.loads(self._run_info.get(PARAMETERS, '{}'))
        return {
            f'{r}.{name}': value for r, values in roles.items() for name, value in values.items()
        }

    @cached_property
    def duration_s(self) -> float:
        """Time [s] between the first and the last message of the odometry; 0 without any."""
        stamps_ns = self.tables[STATE].stamp_ns if STATE in self.tables else ()
        return float((stamps_ns[-1] - stamps_ns[0]) / NS_PER_S) if len(stamps_ns) else 0.0

    @cached_property
    def drive(self) -> Drive:
        """The run as arrays, its finite samples. BagError names what the recording lacks."""
        return drop_nonfinite(drive_from_columns(self.tables, self._run_info, self.source))

    @cached_property
    def series(self) -> Series:
        """Distances and angles at every message of the odometry. Raises BagError as `drive`."""
        return compute_series(self.drive)

    @cached_property
    def metrics(self) -> MetricValues:
        """The metrics by name, as in comparison.json. Raises BagError as `drive`."""
        return MetricValues(metrics.compute_metrics(self.drive, self.series))

    @cached_property
    def signals(self) -> 'pd.DataFrame':
        """The derived signals, one row per message of the odometry, indexed by time [s].

        `describe()` says what each column is. Raises BagError as `drive`, ImportError without
        pandas.
        """
        run = EvaluatedRun(self.drive, self.series, self.tables)
        return frames.signal_frame(self.series.t, compute_signals(run))

    def frame(self, topic: str = '') -> 'pd.DataFrame':
        """Return the messages of a topic as flat columns, indexed by time [s]; see `frames`.

        Without a topic they are the derived signals. Raises UnknownTopicError, a KeyError, for a
        topic without messages, ImportError without pandas.
        """
        return frames.frame_of(topic, self.tables[topic]) if topic else self.signals

    def table(self, topic: str) -> Columns:
        """Return the messages of a topic as numpy columns, without pandas.

        Raises UnknownTopicError, a KeyError, for a topic without messages.
        """
        return self.tables[topic]

    def describe(self, topic: str = '') -> 'pd.DataFrame':
        """Return unit and meaning of the columns of a topic; without one, of the signals.

        Columns of members, `v2o_m.1`, are described once, by the name before the dot. Raises
        UnknownTopicError and ImportError as `frame`.
        """
        if not topic:
            return frames.description_frame(frames.describe_signals())
        self.tables[topic]
        return frames.description_frame(frames.describe_topic(topic))

    def figure(self, name: str = 'comparison') -> 'Figure':
        """Return a figure of the comparison: the sheet of all panels, or one of them.

        Raises BagError for an unknown name, and as `drive`.
        """
        # matplotlib takes a second to load
        from bags.analysis import drawing

        return drawing.draw({self.label: self}, name)

    def __repr__(self) -> str:
        """Return one short line: label, scenario, duration, and the outcome where it is known."""
        try:
            outcome = self.metrics[metrics.VERDICT]
        except BagError:
            outcome = f'{len(self.topics)} topics'
        where = self.scenario or self.source
        return f'Run({self.label!r}, {where}, {self.duration_s:.2f} s: {outcome})'


def load(path: str | os.PathLike[str], label: str = '') -> Run:
    """Read a recording: the folder of a bag, or one MCAP file; needs no ROS.

    Messages that break the contract are left out, with an InvalidMessagesWarning; a damaged bag is
    read up to the damage, with a DamagedBagWarning. Raises BagError when there is no such file, it
    is not a bag, or it holds no message.
    """
    import warnings

    bag = drop_invalid(read.load(Path(path)))
    invalid = [*describe_invalid(count_invalid(bag))]
    for line in invalid:
        warnings.warn(f'{bag.path}: {line}', InvalidMessagesWarning, stacklevel=2)
    present = (topic for topic in bag.recordings if read.has_messages(bag, topic))
    tables = TopicTables(str(bag.path), present, lambda topic: read.columns(bag, [topic])[topic])
    faults = tuple(filter(None, (bag.damage, *invalid)))
    return Run(tables, Origin(str(bag.path), bag.run_info, path=bag.path, faults=faults), label)


def from_tables(tables: Mapping[str, Columns], origin: Origin, label: str = '') -> Run:
    """Return a run whose tables are in memory already, as those of a simulation."""
    return Run(TopicTables(origin.source, tables, tables.__getitem__), origin, label)
