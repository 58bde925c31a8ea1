"""Statistical inference: intervals of shares and of their paired differences."""

import math

CONFIDENCE = 0.95
NEAR = 1e-9


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


def paired_interval(only_first: int, only_second: int, pairs: int) -> tuple[float, float]:
    """Return Tango's score interval of 95 % of the difference of two shares of the same pairs.

    `only_first` and `only_second` are the pairs in which one of the two succeeded alone; the
    difference is (only_first - only_second) / pairs. Unlike an interval that takes the number of
    pairs that differ as given it has a width where all of them fall on one side, and where none
    differs (Tango 1998, doi 10.1002/(SICI)1097-0258(19980430)17:8<891::AID-SIM780>3.0.CO;2-B).
    -1 to 1 without a pair.
    """
    if not pairs:
        return -1.0, 1.0
    # imported late, as above
    from scipy.optimize import brentq
    from scipy.stats import norm

    z = float(norm.ppf((1 + CONFIDENCE) / 2))
    estimate = (only_first - only_second) / pairs

    def excess(difference):
        """Return the distance of a difference from the estimate, less what does not reject it."""
        # share of pairs in which the second succeeds alone, the likeliest given the difference
        b = (2 - estimate) * difference - (only_first + only_second) / pairs
        c = only_second / pairs * difference * (1 - difference)
        second = (math.sqrt(max(0.0, b * b + 8 * c)) - b) / 4
        variance = max(0.0, 2 * second + difference * (1 - difference)) / pairs
        return abs(estimate - difference) - z * math.sqrt(variance)

    # at the estimate itself the variance is 0 where no pair differs
    low = brentq(excess, -1.0, estimate - NEAR) if estimate > -1.0 else -1.0
    high = brentq(excess, estimate + NEAR, 1.0) if estimate < 1.0 else 1.0
    return float(low), float(high)
