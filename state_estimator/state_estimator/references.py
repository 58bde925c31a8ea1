"""What the filter is compared with: a kinematic observer, and the measurements as they are.

Both take the messages that `filter.Filter` takes, need no tyres and state no covariance.
"""

import math

import numpy as np

from msgs_yaml.conversions import NS_PER_S, wrap_angle
from msgs_yaml.types import Chassis, Gnss, Inertial, SensorReading, VehicleState
from state_estimator.estimate import OK, Estimate
from state_estimator.filter import LONGEST_STEP_S, SLOW_MPS
from state_estimator.parameters import EstimatorParams, Vehicle
from state_estimator.vehicle_model import G

GAIN = 2.0  # poles of the observer, over |r|
FORGET_S = 0.5  # without a yaw rate vy cannot be observed: it decays
FIX_SHARE = 0.2  # of the distance to a fix that is made up at once
_NOT_STATED = np.zeros((6, 6))


class Raw:
    """No filter: the last fix moved on, its course as heading, wheel speed, gyroscope, vy = 0."""

    resets, reason = 0, ''  # it never begins anew

    def __init__(self, params: EstimatorParams, vehicle: Vehicle, yaw_rad: float | None = None):
        self._p, self._car, self._yaw = params, vehicle, yaw_rad
        self._fix: Gnss | None = None
        self._chassis: Chassis | None = None
        self._imu: Inertial | None = None
        self._vy = self._turned = 0.0

    def update(self, message: SensorReading) -> Estimate | None:
        """Take a message; return the estimate after one of the IMU, once there is a state."""
        if isinstance(message, Chassis):
            self._chassis = message
        elif isinstance(message, Gnss):
            self._on_fix(message)
        else:
            before, self._imu = self._imu, message
            if self._fix is None or self._chassis is None:
                return None
            dt = (message.stamp_ns - before.stamp_ns) / NS_PER_S if before else 0.0
            self._predict(message, min(max(dt, 0.0), LONGEST_STEP_S))
            return Estimate(self._state(message), _NOT_STATED, self._p.friction, OK)
        return None

    def _on_fix(self, fix):
        self._fix = fix
        r, late_s = (
            (self._imu.r, (self._imu.stamp_ns - fix.stamp_ns) / NS_PER_S)
            if self._imu
            else (0.0, 0.0)
        )
        self._turned = r * late_s

    def _predict(self, imu, dt):
        self._turned += dt * imu.r

    def _speed(self):
        rear = self._chassis.omega[2:]
        return 0.5 * sum(rear) * self._car.wheel_radius_m

    def _state(self, imu):
        fix, since = self._fix, (imu.stamp_ns - self._fix.stamp_ns) / NS_PER_S
        moves = math.hypot(fix.vX, fix.vY) > SLOW_MPS / 4
        if moves or self._yaw is None:
            self._yaw = math.atan2(fix.vY, fix.vX)
        psi = wrap_angle(self._yaw + self._turned)
        X, Y = fix.X + since * fix.vX, fix.Y + since * fix.vY
        return VehicleState(imu.stamp_ns, X, Y, psi, self._speed(), 0.0, imu.r)


class KinematicObserver(Raw):
    """Lateral velocity by integration of the IMU (Farrelly, Wellstead, IEEE CCA 1996).

    With the wheel speed v: vx' = ax + r vy + 2 a |r| (v - vx),
    vy' = ay - r vx + (a^2 - 1) r (v - vx).
    Pose: heading and position are integrated and drawn to the fixes.
    """

    def __init__(self, params: EstimatorParams, vehicle: Vehicle, yaw_rad: float | None = None):
        super().__init__(params, vehicle, yaw_rad)
        self._x: np.ndarray | None = None  # X, Y, psi, vx, vy

    def _on_fix(self, fix):
        super()._on_fix(fix)
        if self._x is None or self._imu is None:
            return
        X, Y, psi, vx, vy = self._x
        since = (self._imu.stamp_ns - fix.stamp_ns) / NS_PER_S
        error = np.array([fix.X + since * fix.vX - X, fix.Y + since * fix.vY - Y, 0.0, 0.0, 0.0])
        if math.hypot(fix.vX, fix.vY) > SLOW_MPS:
            course = math.atan2(fix.vY, fix.vX) + self._turned
            error[2] = wrap_angle(course - psi - math.atan2(vy, vx))
        self._x = self._x + FIX_SHARE * error

    def _predict(self, imu, dt):
        super()._predict(imu, dt)
        if self._x is None:
            first = self._state_of_fix(imu)
            self._x = np.array([first.X, first.Y, first.psi, first.vx, 0.0])
            return
        _, _, psi, vx, vy = self._x
        r, wheel = imu.r, self._speed()
        ax = imu.ax / (1.0 + G * self._car.pitch_radps2)
        ay = imu.ay / (1.0 + G * self._car.roll_radps2)
        miss = wheel - vx
        vx_dot = ax + r * vy + (2.0 * GAIN * abs(r) + 0.5) * miss
        vy_dot = ay - r * vx + (GAIN**2 - 1.0) * r * miss
        if abs(r) < 0.03:
            vy_dot = -vy / FORGET_S
        c, s = math.cos(psi), math.sin(psi)
        self._x = self._x + dt * np.array([vx * c - vy * s, vx * s + vy * c, r, vx_dot, vy_dot])

    def _state_of_fix(self, imu):
        return super()._state(imu)

    def _state(self, imu):
        X, Y, psi, vx, vy = self._x.tolist()
        return VehicleState(imu.stamp_ns, X, Y, wrap_angle(psi), vx, vy, imu.r)
