"""The interval of a share that was counted."""

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
