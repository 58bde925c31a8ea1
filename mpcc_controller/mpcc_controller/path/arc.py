"""A piece of the path as a circular arc: the form in which the reference enters the problem."""

from typing import Any, NamedTuple

import casadi as ca
import numpy as np


def _both(symbolic, numeric):
    """Return a function of numbers and arrays, and of CasADi expressions alike."""

    def function(x):
        return symbolic(x) if isinstance(x, ca.SX | ca.MX) else numeric(x)

    return function


sin = _both(ca.sin, np.sin)
cos = _both(ca.cos, np.cos)
sqrt = _both(ca.sqrt, np.sqrt)


class Arc(NamedTuple):
    """The path around the distance `theta` along it."""

    X: Any  # m, map, the point at theta
    Y: Any  # m, map
    psi: Any  # rad, heading at theta, continuous along the path
    kappa: Any  # 1/m, curvature, left positive
    theta: Any  # m


class Pose(NamedTuple):
    """A point of the path and its heading."""

    X: Any  # m, map
    Y: Any  # m, map
    psi: Any  # rad


def pose_at(arc: Arc, theta) -> Pose:
    """Return the pose at the distance `theta` [m]; numbers or CasADi expressions.

    The chord of the arc points along its mean heading and is d sinc(half) long. Two terms of the
    series of sinc replace sin(half) / half, which is undefined on a straight path: the error is
    half^4 / 120, 1e-7 of the length for a turn of 0.1 rad.
    """
    d = theta - arc.theta
    half = arc.kappa * d / 2
    chord = d * (1 - half**2 / 6)
    return Pose(
        X=arc.X + chord * cos(arc.psi + half),
        Y=arc.Y + chord * sin(arc.psi + half),
        psi=arc.psi + 2 * half,
    )


def contouring_error(pose: Pose, X, Y):
    """Return e_Con [m] of a point: positive to the left of the path (paper, section 3.1: right)."""
    return cos(pose.psi) * (Y - pose.Y) - sin(pose.psi) * (X - pose.X)


def lag_error(pose: Pose, X, Y):
    """Return e_Lag [m] of a point (paper, section 3.1): positive behind the pose."""
    return -cos(pose.psi) * (X - pose.X) - sin(pose.psi) * (Y - pose.Y)
