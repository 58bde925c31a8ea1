"""What a scenario file expects of a run: `expect:`, bounds by the name of a metric.

The metrics are those of comparison.json; which there are, only the evaluation knows. Here their
names are dotted words: `min_v2o_per_obstacle_m.1`.
"""

import math
import re
from collections.abc import Iterator
from typing import Annotated, NamedTuple

from msgs_yaml.strict_yaml import Item, Range, Struct, parse_value

NAME = re.compile(r'[a-z][a-z0-9_]*(\.[A-Za-z0-9_]+)*')
_Number = Annotated[float, Range(-1e300, 1e300, '-')]


class Expectation(NamedTuple):
    """What is expected of one metric: a value, or bounds."""

    metric: str
    value: bool | None = None  # of a yes or no
    at_least: float | None = None
    at_most: float | None = None

    def is_met_by(self, measured: bool | float | None) -> bool:
        """Return whether a measured value is as expected; one that is missing meets no bound."""
        if self.value is not None:
            return measured is self.value
        if measured is None or isinstance(measured, (bool, str)):
            return False
        low = -math.inf if self.at_least is None else self.at_least
        high = math.inf if self.at_most is None else self.at_most
        return low <= measured <= high

    def describe(self) -> str:
        """Return what is expected, for a person."""
        if self.value is not None:
            return 'yes' if self.value else 'no'
        parts = [] if self.at_least is None else [f'at least {self.at_least:g}']
        parts += [] if self.at_most is None else [f'at most {self.at_most:g}']
        return ', '.join(parts)


class _Bounds(Struct):
    """Bounds of a number, one of them or both."""

    at_least: _Number | None
    at_most: _Number | None

    def faults(self) -> Iterator[tuple[tuple[str, ...], str]]:
        """Yield what is wrong beyond the single fields."""
        if self.at_least is None and self.at_most is None:
            yield (), 'is empty; allowed at_least, at_most or both'
        elif (
            self.at_least is not None and self.at_most is not None and self.at_least > self.at_most
        ):
            bounds = f'at_least {self.at_least:g} is above at_most {self.at_most:g}'
            yield (), f'{bounds}; nothing could be both'


class Expectations(tuple[Expectation, ...]):
    """What a scenario file expects, in its order."""

    @classmethod
    def from_item(cls, item: Item) -> 'Expectations':
        """Return the expectations in a node of a file. Raises YamlError."""
        expected = []
        for name, member in item.items().items():
            if not NAME.fullmatch(name):
                raise member.error('is no name of a metric; allowed a-z, 0-9, _ and dots')
            value = member.value()
            if isinstance(value, bool):
                expected.append(Expectation(name, value))
            elif isinstance(value, dict):
                expected.append(Expectation(name, **vars(parse_value(_Bounds, member))))
            else:
                raise member.error('allowed true, false, or a block of at_least and at_most')
        return cls(expected)


NOTHING_EXPECTED = Expectations()
