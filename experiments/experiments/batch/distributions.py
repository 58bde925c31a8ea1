"""Distributions of drawn values, and scrambled Sobol points of them.

    uniform: [low, high]
    log_uniform: [low, high]                      # 0 < low
    normal: [mean, sd], within: [low, high]       # cut off at both ends
    choice: [value, ...]                          # each with the same probability

`sample` takes the points of Sobol' (1967) with the digital scrambling of Matousek (1998), as scipy
has them, through the inverse of each distribution function. The first n draws of a longer sample
are those of a sample of n. A number of draws that is a power of two fills every dimension evenly;
other numbers lose that balance, not the uniformity.
"""

import warnings
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

from msgs_yaml.strict_yaml import Item, Range, closest, parse_value

PAIR = tuple[(Annotated[float, Range(-1e300, 1e300, '-')],) * 2]
MAX_DRAWS = 2**30  # distinct points that 30 bits can tell apart


class Uniform(NamedTuple):
    """Every value from `low` to `high` alike."""

    low: float
    high: float

    def value(self, share: float) -> float:
        """Return the value below which `share`, 0 to 1, of the draws are."""
        return _between(self.low + share * (self.high - self.low), self)

    def ends(self) -> tuple[float, ...]:
        """Return the least and the greatest value."""
        return self.low, self.high


class LogUniform(NamedTuple):
    """Every ratio alike: the logarithm is uniform."""

    low: float
    high: float

    def value(self, share: float) -> float:
        """Return the value below which `share`, 0 to 1, of the draws are."""
        return _between(self.low * (self.high / self.low) ** share, self)

    def ends(self) -> tuple[float, ...]:
        """Return the least and the greatest value."""
        return self.low, self.high


class Normal(NamedTuple):
    """The normal distribution, conditioned on `low` to `high`."""

    mean: float
    sd: float
    low: float
    high: float

    def value(self, share: float) -> float:
        """Return the value below which `share`, 0 to 1, of the draws are."""
        from scipy.special import ndtr, ndtri

        # on the side of the mean where probabilities are small, and differences of them exact
        side = -1.0 if self.low > self.mean else 1.0
        begin, end = (ndtr(side * (edge - self.mean) / self.sd) for edge in (self.low, self.high))
        score = side * float(ndtri(begin + share * (end - begin)))
        return _between(self.mean + self.sd * score, self)

    def ends(self) -> tuple[float, ...]:
        """Return the least and the greatest value."""
        return self.low, self.high


class Choice(NamedTuple):
    """One of some values, each with the same probability."""

    values: tuple[Any, ...]

    def value(self, share: float) -> Any:
        """Return the value in whose part of the interval 0 to 1 `share` lies."""
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]

    def ends(self) -> tuple[Any, ...]:
        """Return all values."""
        return self.values


Distribution = Uniform | LogUniform | Normal | Choice


def parse(item: Item) -> Distribution:
    """Return the distribution of a node of a YAML file.

    Raises YamlError, which names file, line, field and what is allowed.
    """
    members = item.items()
    names = [name for name in members if name in _PARSERS]
    for name, member in members.items():
        if name not in _PARSERS and not (name == 'within' and names == ['normal']):
            hint = closest(name, _PARSERS)
            raise member.error(f'is no distribution{hint}; allowed {", ".join(_PARSERS)}')
    if len(names) != 1:
        raise item.error(f'must have exactly one of {", ".join(_PARSERS)}')
    return _PARSERS[names[0]](item, members)


def sample(
    distributions: Mapping[str, Distribution], count: int, seed: int, first: int = 0
) -> list[dict[str, Any]]:
    """Return draws `first` to `first + count - 1`, each with a value for every name.

    Raises ValueError for draws out of range. The dimensions belong to the names in their order:
    another name or order gives other draws.
    """
    import numpy as np
    from scipy.stats import qmc

    if first < 0 or count < 0 or first + count > MAX_DRAWS:
        raise ValueError(f'draws {first} to {first + count - 1}: allowed 0 to {MAX_DRAWS - 1}')
    if not distributions or not count:
        return [{} for _ in range(count)]
    points = qmc.Sobol(len(distributions), scramble=True, seed=np.random.default_rng(seed))
    if first:
        points.fast_forward(first)
    with warnings.catch_warnings():
        warnings.filterwarnings('ignore', 'The balance properties', UserWarning)
        shares = points.random(count)
    return [
        {
            name: distribution.value(float(share))
            for (name, distribution), share in zip(distributions.items(), row)
        }
        for row in shares
    ]


def _between(value, ends):
    """Return a value that rounding may have moved out of the interval, within it."""
    return min(max(value, ends.low), ends.high)


def _interval(item):
    low, high = parse_value(PAIR, item)
    if not low < high:
        raise item.error(f'is from {low:g} to {high:g}; allowed [low, high] with low < high')
    return low, high


def _parse_uniform(_, members):
    return Uniform(*_interval(members['uniform']))


def _parse_log_uniform(_, members):
    low, high = _interval(members['log_uniform'])
    if low <= 0.0:
        raise members['log_uniform'].error(f'begins at {low:g}; allowed above 0')
    return LogUniform(low, high)


def _parse_normal(item, members):
    mean, sd = parse_value(PAIR, members['normal'])
    if sd <= 0.0:
        raise members['normal'].error(f'has the standard deviation {sd:g}; allowed above 0')
    if 'within' not in members:
        raise item.error('within is missing; allowed [low, high], where the distribution is cut')
    low, high = _interval(members['within'])
    if mean + MAX_SDS * sd < low or mean - MAX_SDS * sd > high:
        raise members['within'].error(
            f'is from {low:g} to {high:g}; allowed intervals within {MAX_SDS} standard '
            f'deviations of the mean {mean:g}'
        )
    return Normal(mean, sd, low, high)


def _parse_choice(_, members):
    values = tuple(element.value() for element in members['choice'].elements())
    for element, value in zip(members['choice'].elements(), values):
        if isinstance(value, dict | list):
            raise element.error('is no single value; allowed numbers, true, false and words')
    if not values:
        raise members['choice'].error('is empty; allowed at least one value')
    return Choice(values)


MAX_SDS = 8  # beyond, a normal distribution has no probability that is worth a draw
_PARSERS = {
    'uniform': _parse_uniform,
    'log_uniform': _parse_log_uniform,
    'normal': _parse_normal,
    'choice': _parse_choice,
}
