"""Fewer samples for the eye: a kilohertz is more than a screen can show, an extreme is not."""

import numpy as np


def keep(values: np.ndarray, bins: int) -> np.ndarray:
    """Return the indices (k,) of the samples of `values` (n,) to draw, ascending.

    The samples are split into `bins` stretches of nearly equal length, and of each the smallest
    and the largest stay, in their order: so every extreme of the whole is drawn, and a line
    through what stays covers the same band as the line through everything. The first and the last
    sample stay, too, and one not-a-number of a stretch that has any, so that gaps stay gaps.
    At most 3 bins + 2 of n remain; all of them when there are not that many.
    """
    n = len(values)
    if n <= 3 * bins + 2:
        return np.arange(n)
    bounds = np.linspace(0, n, bins + 1).astype(int)
    lengths = np.diff(bounds)
    # a stretch is a row; the shorter ones repeat their last sample
    rows = bounds[:-1, None] + np.minimum(np.arange(lengths.max()), lengths[:, None] - 1)
    found = values[rows]
    missing = np.isnan(found)
    lowest = np.argmin(np.where(missing, np.inf, found), axis=1)
    highest = np.argmax(np.where(missing, -np.inf, found), axis=1)
    each = np.arange(bins)
    chosen = [rows[each, lowest], rows[each, highest], [0, n - 1]]
    gaps = missing.any(axis=1)
    chosen.append(rows[each[gaps], np.argmax(missing[gaps], axis=1)])
    return np.unique(np.concatenate(chosen))
