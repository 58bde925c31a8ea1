"""Values as the runs of float64 that stand one after another in their messages. No ROS.

`encode` writes them into message objects, `cdr_templates` straight into serialised messages.
"""

from msgs_yaml import conversions
from msgs_yaml.types import WHEELS, Actuators, Command, Imu, VehicleState, Wheels


def odometry(x: VehicleState) -> tuple[tuple[float, ...], ...]:
    """Return pose (position, quaternion) and twist (linear, angular) of /vehicle/odometry."""
    z, w = conversions.heading_to_quaternion(x.psi)
    return (x.X, x.Y, 0.0, 0.0, 0.0, z, w), (x.vx, x.vy, 0.0, 0.0, 0.0, x.r)


def imu(x: Imu) -> tuple[tuple[float, ...], ...]:
    """Return angular velocity and linear acceleration of /vehicle/imu."""
    return (0.0, 0.0, x.r), (x.ax, x.ay, 0.0)


def actuators(x: Actuators) -> tuple[tuple[float, ...], ...]:
    """Return position, velocity and effort of /vehicle/actuators."""
    rest = (0.0,) * (2 + len(WHEELS))
    return (x.delta, *rest), (x.d_delta, *rest), (0.0, x.Fxf, x.Fxr, *x.torque)


def command(x: Command) -> tuple[tuple[float, ...], ...]:
    """Return position, velocity and effort of /controller/command."""
    return (x.delta, 0.0, 0.0), (x.d_delta, 0.0, 0.0), (0.0, x.Fxf, x.Fxr)


def wheels(x: Wheels) -> tuple[tuple[float, ...], ...]:
    """Return position, velocity and effort of /vehicle/wheels: per wheel spin, Fz, Fx, Fy."""
    position, velocity, effort = [], [], []
    rows = zip(x.omega, x.torque, x.Fz, x.kappa, x.Fx, x.alpha, x.Fy)
    for omega, torque, Fz, kappa, Fx, alpha, Fy in rows:
        position += (0.0, 0.0, kappa, alpha)
        velocity += (omega, 0.0, 0.0, 0.0)
        effort += (torque, Fz, Fx, Fy)
    return tuple(position), tuple(velocity), tuple(effort)
