"""Curves as curvature over distance: the pieces a line is made of. Metres, radians, left positive.

Every piece knows its curvature and the heading gained since its start in closed form.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

# rad; a lane change that turns further ahead than this would come close to driving across
STEEPEST = 1.2
# quadrature over the length of a lane change, exact to rounding up to the steepest
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


class Curve(NamedTuple):
    """A piece of a line; both functions take the distance [m] (n,) since its start."""

    length: float  # m, along the curve
    kappa: Callable[[np.ndarray], np.ndarray]  # 1/m
    turn: Callable[[np.ndarray], np.ndarray]  # rad, heading minus heading at the start


def straight(length: float) -> Curve:
    """Return a straight of a length [m]."""
    return arc(length, 0.0)


def arc(length: float, kappa: float) -> Curve:
    """Return an arc of a length [m] and a curvature [1/m]."""
    return clothoid(length, kappa, kappa)


def clothoid(length: float, kappa_0: float, kappa_1: float) -> Curve:
    """Return a curve whose curvature goes linearly from kappa_0 to kappa_1 [1/m]."""
    rate = (kappa_1 - kappa_0) / length
    return Curve(
        length,
        lambda s: kappa_0 + rate * s,
        lambda s: kappa_0 * s + rate * s**2 / 2,
    )


def lane_change(advance: float, offset: float) -> Curve:
    """Return the curve that moves `offset` [m] to the left within `advance` [m] straight ahead.

    Heading and curvature are zero at both ends. The heading over the share q of the length is
    psi_max 16 q^2 (1 - q)^2, so the curvature is proportional to q (1 - q) (1 - 2 q): to first
    order the quintic of least jerk. psi_max and the length have no closed form, because the curve
    is as long as it is bent; they are solved for. Raises ValueError when the offset is too large
    for the advance.
    """
    steepest = _offset_per_advance(STEEPEST)
    ratio = offset / advance
    if abs(ratio) > steepest:
        raise ValueError(
            f'moves {offset:g} m aside within {advance:g} m; '
            f'allowed at most {steepest * advance:.3g} m for this length'
        )
    psi_max = scipy.optimize.brentq(
        lambda psi: _offset_per_advance(psi) - ratio, -STEEPEST, STEEPEST, xtol=1e-15
    )
    length = advance / _mean(np.cos, psi_max)
    return Curve(
        length,
        lambda s: psi_max / length * _bend(s / length),
        lambda s: psi_max * _swing(s / length),
    )


def _swing(q):
    """Return the heading over the share q of the length, peak 1."""
    return 16 * q**2 * (1 - q) ** 2


def _bend(q):
    """Return the derivative of `_swing`."""
    return 32 * q * (1 - q) * (1 - 2 * q)


def _mean(function, psi_max):
    """Return the mean over the length of a function of the heading."""
    return WEIGHTS @ function(psi_max * _swing((NODES + 1) / 2)) / 2


def _offset_per_advance(psi_max):
    return _mean(np.sin, psi_max) / _mean(np.cos, psi_max)
