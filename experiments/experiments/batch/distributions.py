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
MAX_SDS = 8  # beyond, a normal distribution has no probability that is worth a draw
UNIFORM, LOG_UNIFORM, NORMAL, CHOICE = KINDS = ('uniform', 'log_uniform', 'normal', 'choice')


class Distribution(NamedTuple):
    """How a value is drawn."""

    kind: str  # of KINDS
    ends: tuple[Any, ...]  # the least and the greatest value; of a choice every value
    mean: float = 0.0  # of a normal distribution, before it is cut off at its ends
    sd: float = 1.0  # likewise

    def value(self, share: float) -> Any:
        """Return the value below which `share`, 0 to 1, of the draws are."""
        if self.kind == CHOICE:
            return self.ends[min(int(share * len(self.ends)), len(self.ends) - 1)]
        low, high = self.ends
        if self.kind == UNIFORM:
            value = low + share * (high - low)
        elif self.kind == LOG_UNIFORM:
            value = low * (high / low) ** share
        else:
            from scipy.special import ndtr, ndtri

            # on the side of the mean where probabilities are small, and differences of them exact
            side = -1.0 if low > self.mean else 1.0
            begin, end = (ndtr(side * (edge - self.mean) / self.sd) for edge in self.ends)
            value = self.mean + self.sd * side * float(ndtri(begin + share * (end - begin)))
        # rounding may have moved it out of the interval
        return min(max(value, low), high)


def parse(item: Item) -> Distribution:
    """Return the distribution of a node of a YAML file.

    Raises YamlError, which names file, line, field and what is allowed.
    """
    members = item.items()
    names = [name for name in members if name in KINDS]
    for name, member in members.items():
        if name not in KINDS and not (name == 'within' and names == [NORMAL]):
            hint = closest(name, KINDS)
            raise member.error(f'is no distribution{hint}; allowed {", ".join(KINDS)}')
    if len(names) != 1:
        raise item.error(f'must have exactly one of {", ".join(KINDS)}')
    (kind,) = names
    own = members[kind]
    if kind == CHOICE:
        values = tuple(element.value() for element in own.elements())
        for element, value in zip(own.elements(), values):
            if isinstance(value, dict | list):
                raise element.error('is no single value; allowed numbers, true, false and words')
        if not values:
            raise own.error('is empty; allowed at least one value')
        return Distribution(kind, values)
    if kind != NORMAL:
        low, high = _interval(own)
        if kind == LOG_UNIFORM and low <= 0.0:
            raise own.error(f'begins at {low:g}; allowed above 0')
        return Distribution(kind, (low, high))
    mean, sd = parse_value(PAIR, own)
    if sd <= 0.0:
        raise own.error(f'has the standard deviation {sd:g}; allowed above 0')
    if 'within' not in members:
        raise item.error('within is missing; allowed [low, high], where the distribution is cut')
    low, high = _interval(members['within'])
    if mean + MAX_SDS * sd < low or mean - MAX_SDS * sd > high:
        raise members['within'].error(
            f'is from {low:g} to {high:g}; allowed intervals within {MAX_SDS} standard '
            f'deviations of the mean {mean:g}'
        )
    return Distribution(kind, (low, high), mean, sd)


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
        {name: own.value(float(share)) for (name, own), share in zip(distributions.items(), row)}
        for row in shares
    ]


def _interval(item):
    low, high = parse_value(PAIR, item)
    if not low < high:
        raise item.error(f'is from {low:g} to {high:g}; allowed [low, high] with low < high')
    return low, high
