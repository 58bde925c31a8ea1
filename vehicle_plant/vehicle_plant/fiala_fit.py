"""Least-squares fit of the Fiala brush tyre to one axle.

Fy = -C z + C^2 / (3 Fm) |z| z - C^3 / (27 Fm^2) z^3 with z = tan(alpha) up to sliding at
|z| = 3 Fm / C, then -Fm sign(z); Fm = sqrt((mu Fz)^2 - Fx^2) is what the friction circle leaves
(Pacejka 2012, 3.2; Hindiyeh 2013, 2.2). The fit is written here anew: the plant and the prediction
model share no code.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from vehicle_plant.circle import AxlePoints

_NORMAL_95 = 1.959964


class Fit(NamedTuple):
    """Parameters of one axle; half widths of their 95 % confidence intervals; residual."""

    cornering: float  # N/rad
    friction: float  # -
    cornering_confidence: float  # N/rad
    friction_confidence: float  # -
    residual: float  # N, root mean square


def force(points: AxlePoints, cornering: float, friction: float) -> np.ndarray:
    """Return the lateral force of a Fiala axle [N] at the points' slip, Fx and Fz, (n,)."""
    z = np.tan(points.alpha)
    left = np.sqrt(np.maximum((friction * points.Fz) ** 2 - points.Fx**2, 1.0))
    q = np.minimum(np.abs(z) * cornering / (3 * left), 1)
    return -np.sign(z) * left * (3 * q - 3 * q**2 + q**3)


def fit(points: AxlePoints) -> Fit:
    """Fit cornering stiffness and friction; n >= 3 points, unweighted."""
    load = points.Fz.mean()

    def error(scaled):
        # both parameters of order one: stiffness per load, friction
        return (force(points, scaled[0] * load, scaled[1]) - points.Fy) / load

    steepest = 20.0  # 1/rad, a usual road tyre; the fit does not depend on it
    found = least_squares(error, [steepest, 1.0], bounds=([1.0, 0.01], [200.0, 3.0]), xtol=1e-14)
    degrees = len(points.alpha) - len(found.x)
    variance = 2 * found.cost / degrees
    deviation = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)) * variance)
    return Fit(
        cornering=float(found.x[0] * load),
        friction=float(found.x[1]),
        cornering_confidence=float(_NORMAL_95 * deviation[0] * load),
        friction_confidence=float(_NORMAL_95 * deviation[1]),
        residual=float(np.sqrt(np.mean(found.fun**2)) * load),
    )
