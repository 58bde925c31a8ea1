"""Values of fixed size as flat numbers: which number of a message is which field of its value.

Fields of the contract with a `column` make the value of their topic. A field of the value is one
number, four (one per wheel), or a heading (z and w of its quaternion). `encode`, `decode`,
`cdr_templates` and the tables of `bags` derive from this, so a new number costs a line in
topics.yaml and one in `types`. No ROS.
"""

from collections.abc import Callable, Sequence
from functools import cache
from operator import attrgetter, itemgetter
from typing import Any, NamedTuple

from msgs_yaml import contract, conversions, field_paths
from msgs_yaml.contract import JOINT_ARRAYS, ContractError
from msgs_yaml.types import WHEELS, Actuators, Command, Imu, VehicleState, Wheels

TYPES = {
    '/vehicle/odometry': VehicleState,
    '/vehicle/actuators': Actuators,
    '/vehicle/imu': Imu,
    '/vehicle/wheels': Wheels,
    '/controller/command': Command,
}
HEADING = 'psi'


class FlatFields(NamedTuple):
    """The numbers of a topic in the order of the fields of its value."""

    kind: type  # the named tuple of a value; its first field is `stamp_ns`
    paths: tuple[str, ...]  # of every number in the message
    columns: dict[str, tuple[str, ...]]  # column of a table -> its paths
    joint_indices: tuple[int, ...]  # JointState: in position + velocity + effort
    read: Callable[[Any], tuple]  # message -> its numbers, one per path
    split: tuple[Callable, ...]  # field of the value -> its numbers
    join: tuple[tuple[Callable, slice], ...]  # numbers -> field of the value

    def to_numbers(self, value: Any) -> list[float]:
        """Return the numbers of a value, one per path."""
        _, *fields = value
        return [number for split, field in zip(self.split, fields) for number in split(field)]

    def to_value(self, stamp_ns: int, message: Any) -> Any:
        """Return the value of a message."""
        return self.join_numbers(stamp_ns, list(map(float, self.read(message))))

    def join_numbers(self, stamp_ns: int, numbers: Sequence[float]) -> Any:
        """Return the value of numbers, one per path."""
        return self.kind(stamp_ns, *[join(numbers[part]) for join, part in self.join])

    def __repr__(self):
        return f'FlatFields({self.kind.__name__}, {len(self.paths)} numbers)'


@cache
def load(topic: str) -> FlatFields:
    """Return the numbers of a topic of TYPES; raise KeyError for another topic.

    Raises ContractError if the contract and the type do not have the same fields in this order.
    """
    kind, described = TYPES[topic], contract.load().topics[topic]
    fields: dict[str, list[str]] = {}
    columns: dict[str, list[str]] = {}
    for path, field in described.fields.items():
        if field.column:
            fields.setdefault(field.value, []).append(path)
            columns.setdefault(field.column, []).append(path)
    if ('stamp_ns', *fields) != kind._fields:
        names = ', '.join(fields)
        raise ContractError(f'{topic}: topics.yaml has the values {names}; {kind.__name__} others')
    split, join, first = [], [], 0
    for name, paths in fields.items():
        split_field, join_field = _converters(topic, name, len(paths))
        split.append(split_field)
        join.append((join_field, slice(first, first + len(paths))))
        first += len(paths)
    paths = tuple(path for group in fields.values() for path in group)
    return FlatFields(
        kind,
        paths,
        {column: tuple(group) for column, group in columns.items()},
        _joint_indices(described, paths) if described.joints else (),
        _reader(described, paths),
        tuple(split),
        tuple(join),
    )


def _converters(topic, name, count):
    """Return the functions between a field of a value and its numbers."""
    if name == HEADING and count == 2:
        return conversions.heading_to_quaternion, lambda zw: conversions.quaternion_to_heading(*zw)
    if count == len(WHEELS):
        return tuple, tuple
    if count == 1:
        return lambda number: (number,), itemgetter(0)
    raise ContractError(f'{topic}: the value {name} has {count} fields; allowed 1 or {len(WHEELS)}')


def _joint_indices(topic, paths):
    """Return the index of each path in the concatenation of position, velocity and effort."""
    steps = [step for path in paths for step in field_paths.parse(path)]
    return tuple(
        len(topic.joints) * JOINT_ARRAYS.index(step.attribute) + topic.joints.index(step.selector)
        for step in steps
    )


def _reader(topic, paths):
    """Return the function that reads the numbers of a message."""
    if not topic.joints:
        return attrgetter(*paths)
    get, choose = attrgetter(*JOINT_ARRAYS), itemgetter(*_joint_indices(topic, paths))
    return lambda message: choose([number for array in get(message) for number in array])
