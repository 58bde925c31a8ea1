"""What a scenario file expects of a run: `expect:`, bounds by the name of a metric.

The metrics are those of comparison.json; which there are, only the evaluation knows. Here their
names are dotted words: `min_v2o_per_obstacle_m.1`.
"""

import math
import re
from typing import NamedTuple

from msgs_yaml.strict_yaml import Item

NAME = re.compile(r'[a-z][a-z0-9_]*(\.[A-Za-z0-9_]+)*')
AT_LEAST, AT_MOST = 'at_least', 'at_most'


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


class Expectations(tuple[Expectation, ...]):
    """What a scenario file expects, in its order."""

    @classmethod
    def from_item(cls, item: Item) -> 'Expectations':
        """Return the expectations in a node of a file. Raises YamlError."""
        return cls(_parse(name, member) for name, member in item.items().items())


NOTHING_EXPECTED = Expectations()


def _parse(name, item):
    if not NAME.fullmatch(name):
        raise item.error('is no name of a metric; allowed a-z, 0-9, _ and dots')
    value = item.value()
    if isinstance(value, bool):
        return Expectation(name, value=value)
    if not isinstance(value, dict):
        raise item.error('allowed true, false, or a block of at_least and at_most')
    bounds = item.members((), (AT_LEAST, AT_MOST))
    if not bounds:
        raise item.error('is empty; allowed at_least, at_most or both')
    for bound in bounds.values():
        number = bound.value()
        if isinstance(number, bool) or not isinstance(number, (int, float)):
            raise bound.error('must be a number')
        if not math.isfinite(number):
            raise bound.error(f'is {number}; allowed finite numbers')
    low, high = (value.get(bound) for bound in (AT_LEAST, AT_MOST))
    if low is not None and high is not None and low > high:
        raise item.error(f'at_least {low:g} is above at_most {high:g}; nothing could be both')
    return Expectation(name, None, *(None if b is None else float(b) for b in (low, high)))
