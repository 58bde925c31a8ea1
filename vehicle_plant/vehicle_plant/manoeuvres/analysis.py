"""Reading numbers off a track. Times in s; x, y are arrays over the rows of the track."""

import numpy as np

LOW, HALF, HIGH = 0.1, 0.5, 0.9  # of the steady state: rise time, response time (ISO 7401)
MS_PER_S = 1000


def first_reaching(t: np.ndarray, y: np.ndarray, level: float) -> float:
    """Return the instant at which y first reaches a positive level; nan when it never does."""
    above = np.flatnonzero(y >= level)
    if not len(above):
        return float('nan')
    i = above[0]
    if i == 0:
        return float(t[0])
    return float(np.interp(level, y[i - 1 : i + 1], t[i - 1 : i + 1]))


def at(t: np.ndarray, y: np.ndarray, instant: float) -> float:
    """Return y at an instant."""
    return float(np.interp(instant, t, y))


def slope(x: np.ndarray, y: np.ndarray, *, low: float, high: float) -> float:
    """Return the gradient dy/dx of the straight line through the points with low <= x <= high."""
    inside = (x >= low) & (x <= high)
    return float(np.polyfit(x[inside], y[inside], 1)[0])


def phasor(t: np.ndarray, y: np.ndarray, f_hz: float) -> complex:
    """Return the complex amplitude of exp(2 pi i f t) in y beside a constant and a drift."""
    middle = t - t.mean()
    terms = np.column_stack(
        [np.cos(2 * np.pi * f_hz * t), np.sin(2 * np.pi * f_hz * t), np.ones_like(t), middle]
    )
    (cosine, sine, _, _), *_ = np.linalg.lstsq(terms, y, rcond=None)
    return complex(cosine, -sine)
