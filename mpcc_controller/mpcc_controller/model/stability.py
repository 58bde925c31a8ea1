"""Is a step of the prediction stable? The lateral motion of a slow car is faster than RK2 follows.

The slip angles are lateral speeds over the speed, so the tyres damp the lateral motion at a rate
that grows as the car gets slower. Beyond a rate of 2 / dt an explicit step makes of that damping an
oscillation that grows: the prediction diverges where the car is stable. From which speed on it does
not is a property of the car: it grows with cornering stiffness over mass.
"""

from functools import cache, lru_cache

import casadi as ca
import numpy as np

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, Input, State

LEAST_MPS, GREATEST_MPS, STEP_MPS = 0.5, 30.0, 0.1  # of the speeds that are looked at
STABLE = 0.999  # factor per step


def growth(car: Car, dt: float, vx: float) -> float:
    """Return the factor by which a lateral motion grows in a step of `dt` [s]: the spectral radius.

    Linearised about driving straight ahead at `vx` [m/s].
    """
    jacobian = _jacobian(dt, single_track.structure(car))(vx, ca.vertcat(*car)).full()
    return float(np.max(np.abs(np.linalg.eigvals(jacobian))))


@lru_cache
def least_stable_speed(car: Car, dt: float, least: float = LEAST_MPS) -> float:
    """Return the first speed [m/s] from `least` on at which a step of `dt` [s] is stable.

    Infinite where none is.
    """
    if growth(car, dt, least) < STABLE:
        return least
    speeds = np.arange(least, GREATEST_MPS, STEP_MPS)
    return next((round(float(v), 6) for v in speeds if growth(car, dt, v) < STABLE), np.inf)


@lru_cache
def least_kinematic_speed(car: Car, dt: float) -> float:
    """Return up to which speed [m/s] a car that drives at every speed has to be kinematic.

    It is at least BLEND_FROM_MPS, and so high that every step of `dt` [s] is stable until the blend
    of both models has ended; infinite where none is.
    """
    for low in np.arange(single_track.BLEND_FROM_MPS, GREATEST_MPS, 10 * STEP_MPS):
        blended = car._replace(kinematic_below=low)
        speeds = np.arange(LEAST_MPS, low + single_track.BLEND_MPS + STEP_MPS, STEP_MPS)
        if all(growth(blended, dt, v) < STABLE for v in speeds):
            return float(low)
    return np.inf


@cache
def _jacobian(dt, structure):
    """Return (vx, car) -> the Jacobian of vy and r after a step by those before it."""
    vx, car = ca.SX.sym('vx'), ca.SX.sym('car', len(structure))
    lateral = ca.SX.sym('lateral', 2)
    at_rest = State(*[0.0] * len(State._fields))
    x = at_rest._replace(vx=vx, vy=lateral[0], r=lateral[1])
    u = Input(d_delta=0.0, d_Fx=0.0, lambda_b=0.5, slack=0.0)
    after = State(
        *ca.vertsplit(single_track.step(dt, structure)(ca.vertcat(*x), ca.vertcat(*u), car))
    )
    jacobian = ca.jacobian(ca.vertcat(after.vy, after.r), lateral)
    return ca.Function('lateral', [vx, car], [ca.substitute(jacobian, lateral, ca.DM([0, 0]))])
