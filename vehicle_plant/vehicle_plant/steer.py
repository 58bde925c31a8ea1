"""Steer angles of the wheels: the rack, and what roll and lateral force add.

Both additions are linear, per axle, and positive where they make the car understeer: a front wheel
turns out of the curve, a rear wheel into it. Compliance steer follows the lateral tyre force, which
lags behind slip by the relaxation length, so it closes no algebraic loop. Angles [rad], left
positive; forces [N].
"""

from typing import Any


def with_roll(rack: Any, phi: Any, suspension) -> tuple:
    """Return the angles of rack and roll phi, in the order of WHEELS."""
    front = rack - suspension.front.roll_steer * phi
    return (front,) * 2 + (suspension.rear.roll_steer * phi,) * 2


def with_compliance(angles: tuple, Fy: list, suspension) -> tuple:
    """Return the angles that yield to the wheels' lateral forces Fy; both in the order of WHEELS.

    Left and right yield alike, to the force of their axle.
    """
    fl, fr, rl, rr = angles
    front = suspension.front.compliance_steer_radpn * (Fy[0] + Fy[1])
    rear = suspension.rear.compliance_steer_radpn * (Fy[2] + Fy[3])
    return fl - front, fr - front, rl + rear, rr + rear
