"""Several tests at once: the correction of their p-values."""

from collections.abc import Mapping


def holm(p_values: Mapping[str, float]) -> dict[str, float]:
    """Return the p-values adjusted by Holm's step-down method (1979), in the given order.

    Rejecting those at or below alpha keeps the probability of any false rejection at most alpha,
    whatever the dependence between the tests.
    """
    adjusted, largest = {}, 0.0
    ranked = sorted(p_values, key=lambda name: p_values[name])
    for k, name in enumerate(ranked):
        largest = max(largest, min(1.0, (len(ranked) - k) * p_values[name]))
        adjusted[name] = largest
    return {name: adjusted[name] for name in p_values}
