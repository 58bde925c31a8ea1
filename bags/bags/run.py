"""A run, recorded or simulated: its metrics, tables, derived signals and figure.

    import bags

    run = bags.load('bags/runs/double_lane_change/mpcc')
    run.metrics['min_v2o_m']                       # 0.50
    run.frame('/vehicle/odometry')['vx_mps'].plot()
    run.signals[['station_m', 'sideslip_rad', 'v2o_m.1']]
    run.figure().savefig('mpcc.png')

What is computed is kept: a second access costs nothing.
"""

import json
import os
import warnings
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from bags import frames, metrics_table
from bags.errors import BagError, DamagedBagWarning, InvalidMessagesWarning
from bags.evaluation import metrics, signals
from bags.evaluation.drive import REQUIRED_TOPICS, Drive, drive_from_columns, drop_nonfinite
from bags.evaluation.metrics import METRICS
from bags.evaluation.metrics.registry import EvaluatedDrive, flatten
from bags.storage import read
from bags.storage.columns import Columns
from bags.storage.invalid_messages import KEY, count_invalid, describe_invalid, drop_invalid
from bags.storage.read import STATE
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.strict_yaml import closest
from node_runtime import provenance

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

PARAMETERS = 'parameters'  # the record of the run that holds the parameters of its nodes
NESTED = ('versions', 'machine')  # records that are mappings
NOTHING: Mapping[str, Any] = MappingProxyType({})


class UnknownNameError(BagError, KeyError):
    """A run has no such topic or metric, or a set no such run; the message says what there is."""

    def __str__(self) -> str:
        return self.args[0]


def _known(name, values, key):
    """Return the value of a key of a name. Raises UnknownNameError, which has the whole name."""
    if key not in values:
        raise UnknownNameError(f'no metric {name!r}{closest(name, values)}')
    return values[key]


def _metric(name):
    # a member has the unit of its metric; those of an overshoot both are lengths
    return _known(name, METRICS, name.partition('.')[0])


class MetricValues(Mapping[str, Any]):
    """The metrics of one run: `metrics['min_v2o_m']` is what comparison.json has under this name.

    A metric that has no meaning in the run is None. A member of a dictionary or a list is found by
    its dotted name, too: `metrics['min_v2o_per_obstacle_m.1']`.
    """

    def __init__(self, values: Mapping[str, Any]):
        self._values = dict(values)

    def __getitem__(self, name: str) -> Any:
        return _known(name, self.flat() | self._values, name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def unit(self, name: str) -> str:
        """Return the unit of a metric, '' of one without; KeyError for an unknown name."""
        return _metric(name).unit

    def meaning(self, name: str) -> str:
        """Return what a metric is, in one sentence or more; KeyError for an unknown name."""
        return _metric(name).meaning

    def flat(self) -> dict[str, Any]:
        """Return every single value by dotted name, as the rows of comparison.csv."""
        return flatten(self._values)

    def frame(self) -> 'pd.DataFrame':
        """Return a row per single value: `value`, `unit`, `meaning`. ImportError without pandas."""
        pandas = frames.import_pandas()
        flat = self.flat()
        rows = [(value, self.unit(name), self.meaning(name)) for name, value in flat.items()]
        index = pandas.Index(flat, name='metric')
        return pandas.DataFrame(rows, index=index, columns=['value', 'unit', 'meaning'])

    def __repr__(self) -> str:
        """Return the rows of the printed table, and the verdict."""
        lines = [
            (line.title, line.unit, line.cells[0].text.replace('\n', ', '))
            for line in metrics_table.table_lines({'': self._values})
        ]
        widths = [max(len(line[k]) for line in lines) for k in range(2)]
        rows = (f'{title:<{widths[0]}}  {unit:<{widths[1]}}  {v}' for title, unit, v in lines)
        return '\n'.join((self._values['verdict'], *rows))


class Run(EvaluatedDrive):
    """One run by one controller. Units and axes are those of `bags.storage.columns`.

    label      what it is called in tables and figures; by default the controller, and the label
               of the recording
    path       of a recording, None of a simulation
    tables     by topic, numpy columns
    run_info   the metadata record `run` as it was recorded: texts by name
    settings   what was changed for this run, by dotted name; {} of a recording
    damage     of a recording: where it is damaged, None for a sound one
    invalid    of a recording: the messages that were left out, `{'invalid_messages': ...}`
    """

    def __init__(
        self,
        tables: Mapping[str, Columns],
        source: str,
        run_info: Mapping[str, str],
        label: str = '',
        settings: Mapping[str, Any] = NOTHING,
        path: Path | None = None,
        damage: str | None = None,
        invalid: Mapping[str, Any] = NOTHING,
    ):
        """`source` is the file of a recording, or what was simulated; it begins errors."""
        self.tables = {topic: tables[topic] for topic in frames.FRAMED if topic in tables}
        self.source, self.run_info = source, run_info
        self.settings, self.path, self.damage, self.invalid = dict(settings), path, damage, invalid
        named = provenance.run_name(run_info) if self.controller else Path(source).stem
        self.label = self.name = label or named

    @property
    def scenario(self) -> str:
        """The name of the scenario; '' where the recording does not say it."""
        return self.run_info.get('scenario', '')

    @property
    def controller(self) -> str:
        """The name of the controller; '' where the recording does not say it."""
        return self.run_info.get('controller', '')

    @property
    def topics(self) -> tuple[str, ...]:
        """The topics that `frame` and `table` know."""
        return tuple(self.tables)

    @property
    def faults(self) -> tuple[str, ...]:
        """What was left out of a damaged recording, one sentence each."""
        return (*((self.damage,) if self.damage else ()), *describe_invalid(self.invalid))

    @cached_property
    def metadata(self) -> dict[str, Any]:
        """What was recorded about the run besides its parameters: scenario, mode, versions, ...."""
        known = {name: value for name, value in self.run_info.items() if name != PARAMETERS}
        return known | {name: json.loads(known[name]) for name in NESTED if name in known}

    @cached_property
    def parameters(self) -> dict[str, Any]:
        """Every parameter of every node by dotted name, `controller.tolerances.contouring_m`."""
        roles = json.loads(self.run_info.get(PARAMETERS, '{}'))
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
        for topic in REQUIRED_TOPICS:
            self.table(topic)
        return drop_nonfinite(drive_from_columns(self.tables, self.run_info, self.source))

    @cached_property
    def metrics(self) -> MetricValues:
        """The metrics by name, as in comparison.json. Raises BagError as `drive`."""
        return MetricValues(metrics.metrics_of(self))

    @cached_property
    def signals(self) -> 'pd.DataFrame':
        """The derived signals, one row per message of the odometry, indexed by time [s].

        `describe()` says what each column is. Raises BagError as `drive`, ImportError without
        pandas.
        """
        pandas = frames.import_pandas()
        index = pandas.Index(self.series.t, name=frames.INDEX)
        return pandas.DataFrame(signals.compute_signals(self), index=index)

    def frame(self, topic: str = '') -> 'pd.DataFrame':
        """Return the messages of a topic as flat columns, indexed by time [s]; see `frames`.

        Without a topic they are the derived signals. Raises UnknownNameError, a KeyError, for a
        topic without messages, ImportError without pandas.
        """
        return frames.frame_of(topic, self.table(topic)) if topic else self.signals

    def table(self, topic: str) -> Columns:
        """Return the messages of a topic as numpy columns, without pandas.

        Raises UnknownNameError, a KeyError, for a topic without messages.
        """
        if topic in self.tables:
            return self.tables[topic]
        refused = self.invalid.get(KEY, {}).get(topic)
        invalid = read.InvalidMessages(**refused) if refused else None
        text = read.describe_missing(topic, self.tables, frames.FRAMED, invalid)
        raise UnknownNameError(f'{self.source}: {text}')

    def describe(self, topic: str = '') -> 'pd.DataFrame':
        """Return unit and meaning of the columns of a topic; without one, of the signals.

        Columns of members, `v2o_m.1`, are described once, by the name before the dot. Raises
        UnknownNameError and ImportError as `frame`.
        """
        if topic:
            self.table(topic)
        return frames.describe(topic)

    def figure(self, name: str = 'comparison') -> 'Figure':
        """Return a figure of the comparison: the sheet of all panels, or one of them.

        Raises BagError for an unknown name, and as `drive`.
        """
        # matplotlib takes a second to load
        from bags.figures import comparison_figures

        return comparison_figures.draw({self.label: self}, name)

    def __repr__(self) -> str:
        """Return one short line: label, scenario, duration, and the outcome where it is known."""
        try:
            outcome = self.metrics['verdict']
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
    run = load_quietly(path, label)
    if run.damage:
        warnings.warn(run.damage, DamagedBagWarning, stacklevel=2)
    for line in describe_invalid(run.invalid):
        warnings.warn(f'{run.source}: {line}', InvalidMessagesWarning, stacklevel=2)
    return run


def load_quietly(path: str | os.PathLike[str], label: str = '') -> Run:
    """Read a recording as `load` does; what was left out is in `Run.faults`, without a warning."""
    bag = drop_invalid(read.load(Path(path), warn=False))
    return Run(
        read.columns(bag),
        str(bag.path),
        bag.run_info,
        label,
        path=bag.path,
        damage=bag.damage,
        invalid=count_invalid(bag),
    )
