"""Fiala tyre of one axle inside its friction circle (paper, eq. 2 and section 2). SI units.

Every function takes numbers or CasADi expressions. Slip enters as its tangent, so that the force
is a polynomial of it; forces are in the wheel frame, positive to the left and forwards.
"""

import casadi as ca

# The longitudinal force uses at most this share of the friction: the remaining lateral capacity,
# sqrt(1 - 0.99^2) = 14 %, keeps the square root of the friction circle differentiable.
LONGITUDINAL_SHARE = 0.99
# Rounding of the saturation, relative to the friction. At 95 % of the friction the force is 0.2 %
# below the demand.
LOCK_ROUNDING = 0.02


def longitudinal_force(demand, Fz, mu):
    """Return the longitudinal force [N] of an axle for a demand [N], saturated by its friction.

    It equals the demand well below `mu Fz` and saturates smoothly, as a locking wheel does. Without
    the saturation the RK2 midpoints and the last stage, which no constraint covers, leave the
    friction circle and the root in `lateral_capacity` turns imaginary.
    """
    capacity = LONGITUDINAL_SHARE * mu * Fz
    rounding = (LOCK_ROUNDING * capacity) ** 2
    above = ca.sqrt((demand + capacity) ** 2 + rounding)
    below = ca.sqrt((demand - capacity) ** 2 + rounding)
    return (above - below) / 2


def lateral_capacity(Fx, Fz, mu):
    """Return the lateral force [N] that the friction circle leaves beside `Fx` [N]."""
    return ca.sqrt((mu * Fz) ** 2 - Fx**2)


def lateral_force(tan_alpha, capacity, C, switch):
    """Return the lateral force [N] at the slip `tan_alpha` [-], negative for positive slip.

    With s = C tan(alpha) / (3 capacity) the Fiala force is -capacity s (3 - 3 |s| + s^2) up to
    full sliding at |s| = 1. Its gradient vanishes there, so that the optimiser gets no descent
    direction. From |s| = `switch` on the curve is therefore continued with its tangent;
    `switch` = 1 is the plain Fiala tyre. `C` [N/rad] is the cornering stiffness of the axle.
    """
    s = C * tan_alpha / (3 * capacity)
    clipped = ca.fmin(ca.fmax(s, -switch), switch)
    curve = clipped * (3 - 3 * ca.fabs(clipped) + clipped**2)
    tangent = 3 * (1 - switch) ** 2 * (s - clipped)
    return -capacity * (curve + tangent)


def remaining_slip(tan_alpha, capacity, C, switch, compliance):
    """Return the slip [-] that a wheel keeps which gives way to the force of `lateral_force`.

    It gives way by `compliance` [rad/N]: the slip z that is left solves z - compliance F(z) =
    tan(alpha), in closed form. With k = compliance C and p = 1 - |s| that is the cubic
    k p^3 + 3 p = k + 3 - 3 |S|, where S is s of `tan_alpha`; beyond `switch` the force is linear.
    """
    k, scale = compliance * C, 3 * capacity / C
    S = tan_alpha / scale
    bend = switch * (1 + k * (1 - switch + switch**2 / 3))
    bent = ca.fmin(ca.fmax(S, -bend), bend)
    half = ca.sqrt(k) * (k + 3 - 3 * ca.fabs(bent)) / 2
    share = 1 - 2 / ca.sqrt(k) * ca.sinh(ca.asinh(half) / 3)
    # `share` is |s|; divided so the derivative is right where the slip is 0, and |s| has a corner
    s = bent / (1 + k * (1 - share + share**2 / 3))
    return scale * (s + (S - bent) / (1 + k * (1 - switch) ** 2))
