"""The contract of every topic, read from topics.yaml; errors name the line.

The format is described at the top of topics.yaml. No ROS is needed to read it.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from math import inf
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

from msgs_yaml import field_paths, share
from msgs_yaml.strict_yaml import (
    Choice,
    Leaf,
    Pattern,
    Range,
    Struct,
    YamlError,
    parse_value,
    read,
)

MODES = LOCKSTEP, REALTIME = ('lockstep', 'realtime')
TYPES = (
    'builtin_interfaces/msg/Time',
    'diagnostic_msgs/msg/DiagnosticArray',
    'nav_msgs/msg/Odometry',
    'nav_msgs/msg/Path',
    'rosgraph_msgs/msg/Clock',
    'sensor_msgs/msg/Imu',
    'sensor_msgs/msg/JointState',
    'sensor_msgs/msg/PointCloud2',
    'trajectory_msgs/msg/JointTrajectory',
    'visualization_msgs/msg/MarkerArray',
)
# of topics that follow from others or are those of ROS; tf2_msgs is not everywhere
DERIVED_TYPES = (
    *('std_msgs/msg/String', 'tf2_msgs/msg/TFMessage'),
    *('rcl_interfaces/msg/Log', 'lifecycle_msgs/msg/TransitionEvent'),
)
DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
JOINT_STATE = 'sensor_msgs/msg/JointState'
POINT_CLOUD = 'sensor_msgs/msg/PointCloud2'
JOINT_ARRAYS = ('position', 'velocity', 'effort')
UNITS = (
    'm',
    'm/s',
    'm/s^2',
    'rad',
    'rad/s',
    'N',
    'N/s',
    'N m',
    's',
    'ms',
    'ns',
    '-',
    'word',
    'm^2',
    'm rad',
    'rad^2',
    'm^2/s^2',
    'm rad/s^2',
    'rad^2/s^2',
)
WORD = 'word'
ContractError = YamlError
_TOPIC_NAME = re.compile(r'(/[a-z][a-z0-9_]*)+')
_Text = Annotated[str, Pattern(r'(?s).*\S.*', 'a text that is not empty')]
_Rate = Annotated[float, Range(0.0, 1e4, 'Hz')]
_Number = Annotated[float, Range(-inf, inf, '-')]
_Count = Annotated[int, Range(0, 10**9, 'elements')]
_Fault = Iterator[tuple[tuple[str, ...], str]]  # of a block: keys that lead to it, what is wrong


class Qos(Struct):
    """Quality of service of a topic in one mode."""

    reliability: Literal['reliable', 'best_effort']
    durability: Literal['volatile', 'transient_local']
    history: Literal['keep_all', 'keep_last']
    depth: Annotated[int, Range(1, 10**6, 'messages')] = 0  # messages kept; 0 with keep_all
    deadline_ms: Annotated[float, Range(1e-3, 1e6, 'ms')] | None = None

    def faults(self) -> _Fault:
        """Yield what is wrong beyond the single fields."""
        if (self.history == 'keep_last') != bool(self.depth):
            yield (), 'depth belongs to keep_last, and keep_last needs it'


class Field(Struct):
    """One number of a message: its symbol, unit and allowed range, bounds included."""

    symbol: _Text
    unit: Literal[UNITS]
    low: _Number | None
    high: _Number | None
    value: _Text = ''  # field of the named tuple in `types`; by default the symbol
    column: _Text = ''  # in the table of a recording

    def faults(self) -> _Fault:
        """Yield what is wrong beyond the single fields."""
        for name in ('low', 'high'):
            if (self.unit == WORD) != (getattr(self, name) is None):
                yield (), f'{name} belongs to a number, and a number needs it'
        if self.unit != WORD and self.low > self.high:
            yield (), f'low {self.low} is above high {self.high}'
        if self.value and not self.column:
            yield (), 'value needs a column'


class Column(Struct):
    """What is in a column of the table of a recording, or in all columns of its members."""

    meaning: _Text
    unit: str = ''  # by default that of the fields with this column


class Size(NamedTuple):
    """Least and most elements of an array."""

    low: int
    high: int


class _Topic(Struct):
    """One topic as it is in the file."""

    meaning: _Text
    type: Literal[TYPES + DERIVED_TYPES]
    publisher: _Text
    rate_hz: dict[Literal[MODES], _Rate]
    frame: str
    child_frame: _Text | None
    qos: dict[Literal[MODES], str]
    fields: dict[str, Field] = field(default_factory=dict)
    sizes: dict[str, tuple[_Count, _Count]] = field(default_factory=dict)
    columns: dict[str, Column] = field(default_factory=dict)
    held_s: Annotated[float, Range(0.0, 1.0, 's')] = 0.0  # 0: the next message replaces the last

    def faults(self) -> _Fault:
        """Yield what is wrong beyond the single fields."""
        for path, number in self.fields.items():
            if number.column and number.column not in self.columns:
                yield ('fields', path), f'{number.column} is not among the columns'
        for path, (low, high) in self.sizes.items():
            if low > high:
                yield ('sizes', path), f'least {low} is above most {high}'
        for part, path in [('fields', p) for p in self.fields] + [('sizes', p) for p in self.sizes]:
            try:
                selectors = [step.selector for step in field_paths.parse(path)]
            except ValueError as error:
                yield (part, path), str(error)
                continue
            if part == 'sizes':
                continue
            if self.type == JOINT_STATE and (len(selectors) != 1 or selectors[0] in (None, '*')):
                yield (part, path), 'a field of a JointState is written as position[name]'
            if self.type == POINT_CLOUD and not re.fullmatch(r'data\[[a-z_]+\]', path):
                yield (part, path), 'a field of a PointCloud2 is written as data[name]'
            if self.type == DIAGNOSTICS and (len(selectors) != 3 or None in selectors[:2]):
                written = 'status[*].values[key].value'
                yield (part, path), f'a field of a DiagnosticArray is written as {written}'


class _File(Struct):
    """topics.yaml."""

    profiles: dict[str, Qos]
    topics: dict[str, _Topic]
    derived: dict[str, _Topic] = field(default_factory=dict)

    def faults(self) -> _Fault:
        """Yield what is wrong beyond the single topics."""
        profiles, used = Leaf(str, False, Choice(*self.profiles)), set()
        for part, allowed in (('topics', TYPES), ('derived', DERIVED_TYPES)):
            types = Leaf(str, False, Choice(*allowed))
            for name, topic in getattr(self, part).items():
                if not _TOPIC_NAME.fullmatch(name):
                    yield (part, name), 'allowed a leading / and words of a-z, 0-9 and _'
                if fault := types.fault(topic.type):
                    yield (part, name, 'type'), fault
                if bool(topic.fields) != (part == 'topics'):
                    yield (part, name), 'fields belong to topics that are not derived'
                for mode, profile in topic.qos.items():
                    used.add(profile)
                    if fault := profiles.fault(profile):
                        yield (part, name, 'qos', mode), fault
        for name in self.profiles.keys() - used:
            yield ('profiles', name), 'no topic uses this profile'


class Topic(_Topic):
    """One topic; what depends on the mode is keyed by it, `fields` and `sizes` by path."""

    qos: dict[str, Qos]
    sizes: dict[str, Size] = field(default_factory=dict)
    name: str = ''
    profiles: dict[str, str] = field(default_factory=dict)  # name of the QoS by mode

    @property
    def on_request(self) -> bool:
        """Whether it is published on request only: then its rate is 0 in every mode."""
        return not any(self.rate_hz.values())

    def requested_qos(self, mode: str) -> Qos:
        """Return what a subscription asks for: no more than it needs.

        So the publishers of other programs match, too. No deadline, and, on the wall clock, not the
        last message of a latched topic, which is repeated.
        """
        offered = self.qos[mode]
        is_repeated = mode == REALTIME and self.rate_hz[mode] > 0
        durability = 'volatile' if is_repeated else offered.durability
        return replace(offered, durability=durability, deadline_ms=None)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of a JointState in the order of the message."""
        if self.type != JOINT_STATE:
            return ()
        return tuple(dict.fromkeys(field_paths.parse(path)[0].selector for path in self.fields))


@dataclass(frozen=True)
class Contract:
    """Every topic by its name: those of the system, and what others derive from them."""

    topics: dict[str, Topic]
    derived: dict[str, Topic]  # recorded where the type is installed, not decoded

    def find(self, name: str) -> Topic:
        """Return a topic of either kind. Raises KeyError."""
        return self.topics[name] if name in self.topics else self.derived[name]


@cache
def load() -> Contract:
    """Return the contract of this package, read once per process; raise as `read_contract`."""
    return read_contract(share.path('msgs_yaml', 'topics.yaml'))


def read_contract(path: Path) -> Contract:
    """Read the contract of a file.

    Raises ContractError, text `<file>:<line>: <key>: <what is wrong>`.
    """
    file = parse_value(_File, read(path))

    def topic(name, described):
        parts = vars(described) | {'name': name, 'profiles': described.qos}
        parts['qos'] = {mode: file.profiles[name] for mode, name in described.qos.items()}
        parts['fields'] = {
            path: replace(number, value=number.value or number.symbol) if number.column else number
            for path, number in described.fields.items()
        }
        parts['sizes'] = {path: Size(*size) for path, size in described.sizes.items()}
        return Topic(**parts)

    parts = file.topics, file.derived
    return Contract(*({name: topic(name, part[name]) for name in part} for part in parts))
