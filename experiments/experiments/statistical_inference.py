"""Statistical inference: the interval of a counted share, p-values of several tests at once."""

from collections.abc import Mapping

CONFIDENCE = 0.95


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the Wilson score interval of 95 % of a share (Wilson 1927): 0 to 1 without a trial.

    Unlike the normal approximation it never leaves 0 to 1, and has a width where all succeed.
    """
    # imported late: scipy.stats takes half a second to load
    from scipy.stats import binomtest

    if not trials:
        return 0.0, 1.0
    interval = binomtest(successes, trials).proportion_ci(CONFIDENCE, method='wilson')
    return float(interval.low), float(interval.high)


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
