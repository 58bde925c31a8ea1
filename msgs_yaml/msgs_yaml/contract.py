"""The contract of every topic, read from topics.yaml; errors name the line.

The format is described at the top of topics.yaml. No ROS is needed to read it.
"""

import re
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

from msgs_yaml import field_paths, share
from msgs_yaml.strict_yaml import Item, YamlError, read

MODES = LOCKSTEP, REALTIME = ('lockstep', 'realtime')
TYPES = (
    'builtin_interfaces/msg/Time',
    'diagnostic_msgs/msg/DiagnosticArray',
    'nav_msgs/msg/Odometry',
    'nav_msgs/msg/Path',
    'rosgraph_msgs/msg/Clock',
    'sensor_msgs/msg/Imu',
    'sensor_msgs/msg/JointState',
    'visualization_msgs/msg/MarkerArray',
)
# of topics that follow from others or are those of ROS; tf2_msgs is not everywhere
DERIVED_TYPES = (
    *('std_msgs/msg/String', 'tf2_msgs/msg/TFMessage'),
    *('rcl_interfaces/msg/Log', 'lifecycle_msgs/msg/TransitionEvent'),
)
DIAGNOSTICS = 'diagnostic_msgs/msg/DiagnosticArray'
JOINT_STATE = 'sensor_msgs/msg/JointState'
JOINT_ARRAYS = ('position', 'velocity', 'effort')
UNITS = ('m', 'm/s', 'm/s^2', 'rad', 'rad/s', 'N', 'N/s', 'N m', 's', 'ms', 'ns', '-', 'word')
WORD = 'word'
ContractError = YamlError
_TOPIC_NAME = re.compile(r'(/[a-z][a-z0-9_]*)+')


@dataclass(frozen=True)
class Qos:
    """Quality of service of a topic in one mode."""

    name: str
    reliability: str  # reliable | best_effort
    durability: str  # volatile | transient_local
    history: str  # keep_all | keep_last
    depth: int  # messages kept; 0 with keep_all
    deadline_ms: float | None


@dataclass(frozen=True)
class Field:
    """One number of a message: its symbol, unit and allowed range, bounds included."""

    symbol: str
    unit: str
    low: float
    high: float
    value: str = ''  # field of the named tuple in `types`; '' without a column
    column: str = ''  # in the table of a recording


class Size(NamedTuple):
    """Least and most elements of an array."""

    low: int
    high: int


@dataclass(frozen=True)
class Topic:
    """One topic; `rate_hz` and `qos` are keyed by mode, `fields` and `sizes` by path."""

    name: str
    meaning: str
    type: str
    publisher: str
    rate_hz: dict[str, float]
    frame: str
    child_frame: str | None
    qos: dict[str, Qos]
    sizes: dict[str, Size]
    fields: dict[str, Field]

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


def load(path: Path | None = None) -> Contract:
    """Read a contract, by default the one of this package (read once per process).

    Raises ContractError, text `<file>:<line>: <key>: <what is wrong>`.
    """
    return _load(Path(path)) if path else _default()


@cache
def _default():
    return _load(share.path('msgs_yaml', 'topics.yaml'))


def _load(path):
    root = read(path).members(('profiles', 'topics'), ('derived',))
    profiles = {name: _qos(name, item) for name, item in root['profiles'].items().items()}
    topics = {name: _topic(name, item, profiles) for name, item in root['topics'].items().items()}
    items = root['derived'].items() if 'derived' in root else {}
    derived = {name: _derived_topic(name, item, profiles) for name, item in items.items()}
    used = {q.name for topic in (*topics.values(), *derived.values()) for q in topic.qos.values()}
    for name, item in root['profiles'].items().items():
        if name not in used:
            raise item.error('no topic uses this profile')
    return Contract(topics, derived)


def _qos(name, item):
    m = item.members(('reliability', 'durability', 'history'), ('depth', 'deadline_ms'))
    history = m['history'].word(('keep_all', 'keep_last'))
    if (history == 'keep_last') != ('depth' in m):
        raise item.error('depth belongs to keep_last, and keep_last needs it')
    deadline_ms = m['deadline_ms'].number() if 'deadline_ms' in m else None
    if deadline_ms is not None and not 0 < deadline_ms < 1e6:
        raise m['deadline_ms'].error(f'must be above 0 and below 1e6, is {deadline_ms}')
    return Qos(
        name=name,
        reliability=m['reliability'].word(('reliable', 'best_effort')),
        durability=m['durability'].word(('volatile', 'transient_local')),
        history=history,
        depth=m['depth'].whole(1) if 'depth' in m else 0,
        deadline_ms=deadline_ms,
    )


_HEAD = ('meaning', 'type', 'publisher', 'rate_hz', 'frame', 'qos')


def _topic(name, item, profiles):
    m = item.members((*_HEAD, 'fields'), ('child_frame', 'sizes'))
    kind = m['type'].word(TYPES)
    fields = m['fields'].items()
    for path, field in fields.items():
        _check_path(path, field, kind)
    sizes = m['sizes'].items() if 'sizes' in m else {}
    for path, size in sizes.items():
        _check_path(f'{path}[*]', size, None)
    return _describe(
        (name, item, m, kind),
        profiles,
        {path: _size(size) for path, size in sizes.items()},
        {path: _field(field) for path, field in fields.items()},
    )


def _derived_topic(name, item, profiles):
    m = item.members(_HEAD, ('child_frame',))
    return _describe((name, item, m, m['type'].word(DERIVED_TYPES)), profiles, {}, {})


def _describe(head, profiles, sizes, fields):
    name, item, m, kind = head
    if not _TOPIC_NAME.fullmatch(name):
        raise item.error('a topic is named with a leading / and words of a-z, 0-9 and _')
    qos = {mode: q.word(tuple(profiles)) for mode, q in m['qos'].members(MODES).items()}
    return Topic(
        name=name,
        meaning=_filled(m['meaning']),
        type=kind,
        publisher=_filled(m['publisher']),
        rate_hz={mode: _rate(rate) for mode, rate in m['rate_hz'].members(MODES).items()},
        frame=m['frame'].text(),
        child_frame=_filled(m['child_frame']) if 'child_frame' in m else None,
        qos={mode: profiles[profile] for mode, profile in qos.items()},
        sizes=sizes,
        fields=fields,
    )


def _check_path(path, item: Item, kind):
    try:
        steps = field_paths.parse(path)
    except ValueError as error:
        raise item.error(str(error)) from None
    selectors = [step.selector for step in steps]
    if kind == JOINT_STATE and (len(steps) != 1 or selectors[0] in (None, '*')):
        raise item.error('a field of a JointState is written as position[name]')
    if kind == DIAGNOSTICS and (len(steps) != 3 or None in selectors[:2]):
        raise item.error('a field of a DiagnosticArray is written as status[*].values[key].value')


def _rate(item):
    rate = item.number()
    if not 0 <= rate <= 1e4:
        raise item.error(f'must lie in 0 to 10000 Hz, is {rate}')
    return rate


def _size(item):
    elements = item.elements()
    if len(elements) != 2:
        raise item.error('must be [least, most]')
    low, high = (element.whole(0) for element in elements)
    if low > high:
        raise item.error(f'least {low} is above most {high}')
    return Size(low, high)


def _field(item):
    is_word = 'unit' in item.items() and item.items()['unit'].value() == WORD
    range_keys = () if is_word else ('low', 'high')
    m = item.members(('symbol', 'unit', *range_keys), ('value', 'column'))
    unit = m['unit'].word(UNITS)
    low = -float('inf') if is_word else m['low'].number()
    high = float('inf') if is_word else m['high'].number()
    if low > high:
        raise item.error(f'low {low} is above high {high}')
    if 'value' in m and 'column' not in m:
        raise item.error('value needs a column')
    symbol = _filled(m['symbol'])
    column = _filled(m['column']) if 'column' in m else ''
    value = _filled(m['value']) if 'value' in m else symbol if column else ''
    return Field(symbol, unit, low, high, value, column)


def _filled(item):
    text = item.text()
    if not text.strip():
        raise item.error('is empty')
    return text
