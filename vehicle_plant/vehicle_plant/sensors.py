"""What a car senses of its motion: an IMU, wheel speeds and steering angle, a receiver. SI units.

    IMU         accelerations in the rolling and pitching body, so gravity leaks into them; yaw and
                roll rate. Constant bias, its random walk, white noise (IEEE Std 952 names them)
    chassis     steering angle; wheel speeds from the teeth that passed and the times of the last
                ones, as control units compute them: each lags, and ends at a crawl
    receiver    position and velocity of the centre of gravity, which arrive late and may fail

Errors are a function of the seed and the stamp: the same drive is measured alike again.
"""

import math
from collections import deque
from typing import Annotated, NamedTuple

import numpy as np

from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import WHEELS, Chassis, Gnss, Inertial, SensorReading
from node_runtime.parameters import Range, Struct
from vehicle_plant.car import Car
from vehicle_plant.state import Trajectory, join_trajectories

TOPICS = INERTIAL, CHASSIS, GNSS = '/sensors/inertial', '/sensors/chassis', '/sensors/gnss'
MS = 1_000_000  # ns
# of the trajectory, what an IMU feels
FELT = 'acceleration.ax', 'acceleration.ay', 'ride.phi', 'ride.theta', 'planar.r', 'ride.p'
STANDSTILL_S = 0.5  # without a tooth: a wheel stands
# streams of random numbers, independent of each other
OF_DRIVE, OF_IMU, OF_CHASSIS, OF_RECEIVER, OF_OUTAGE = range(5)
Share = Range(0.0, 1.0, '-')


class ImuErrors(Struct):
    """Standard deviations of the IMU's errors."""

    period_ms: Annotated[int, Range(1, 10, 'ms')]  # between two measurements
    acceleration_bias_mps2: Annotated[float, Range(0.0, 5.0, 'm/s^2')]
    acceleration_noise: Annotated[float, Range(0.0, 1.0, 'm/s^2 per root Hz')]
    acceleration_walk: Annotated[float, Range(0.0, 1.0, 'm/s^2 per root second')]
    rate_bias_radps: Annotated[float, Range(0.0, 0.5, 'rad/s')]
    rate_noise: Annotated[float, Range(0.0, 0.1, 'rad/s per root Hz')]
    rate_walk: Annotated[float, Range(0.0, 0.1, 'rad/s per root second')]


class ChassisErrors(Struct):
    """Errors of wheel speeds and steering angle."""

    period_ms: Annotated[int, Range(1, 50, 'ms')]  # between two messages
    teeth: Annotated[int, Range(10, 500, 'edges per turn of a wheel')]
    radius_error: Annotated[float, Range(0.0, 0.1, '-')]  # of each rolling radius
    steer_bias_rad: Annotated[float, Range(0.0, 0.1, 'rad')]
    steer_noise_rad: Annotated[float, Range(0.0, 0.1, 'rad')]
    steer_step_rad: Annotated[float, Range(0.0, 0.1, 'rad')]  # resolution


class ReceiverErrors(Struct):
    """Errors of the receiver."""

    period_ms: Annotated[int, Range(10, 1000, 'ms')]  # between two fixes
    latency_ms: Annotated[int, Range(0, 500, 'ms')]  # from a fix to its message
    position_noise_m: Annotated[float, Range(0.0, 10.0, 'm')]  # white
    position_drift_m: Annotated[float, Range(0.0, 10.0, 'm')]  # correlated in time
    drift_s: Annotated[float, Range(1.0, 1e4, 's')]  # its time constant
    velocity_noise_mps: Annotated[float, Range(0.0, 5.0, 'm/s')]  # along each axis
    outage: Annotated[float, Share]  # share of time without fixes
    outage_s: Annotated[float, Range(0.1, 60.0, 's')]  # duration of one


class SensorParams(Struct):
    """Errors of all sensors: config/sensors_automotive.yaml."""

    imu: ImuErrors
    chassis: ChassisErrors
    receiver: ReceiverErrors


class Reading(NamedTuple):
    """A message of a sensor when it arrives."""

    topic: str
    value: SensorReading


class Sensors:
    """The sensors of one drive."""

    def __init__(self, params: SensorParams, car: Car, seed: int, start: Trajectory):
        """Begin at a trajectory of one row: the car came there at constant velocity."""
        self._p, self._gravity = params, car.body.gravity_mps2
        self._generator = np.random.Generator(np.random.Philox(key=seed))
        self._philox_state = self._generator.bit_generator.state
        self._tooth = 2 * math.pi / params.chassis.teeth
        self._start_ns = int(start.stamp_ns[0])
        n = self._normal(OF_DRIVE, 0, 12)
        imu, chassis, receiver = params.imu, params.chassis, params.receiver
        periods_ms = imu.period_ms, chassis.period_ms, receiver.period_ms, receiver.latency_ms
        self._step_ns = math.gcd(*periods_ms) * MS  # in between nothing is measured or arrives
        self._bias = np.repeat([imu.acceleration_bias_mps2, imu.rate_bias_radps], 2) * n[:4]
        root_s = math.sqrt(imu.period_ms / 1000)
        self._bias_walk = np.repeat([imu.acceleration_walk, imu.rate_walk], 2) * root_s
        self._imu_noise = np.repeat([imu.acceleration_noise, imu.rate_noise], 2) / root_s
        self._steer_bias = chassis.steer_bias_rad * n[4]
        # as a control unit sees it, which divides by the radius that it knows
        self._spin_scale = (1 + chassis.radius_error * n[5:9]).tolist()
        self._drift = receiver.position_drift_m * n[9:11]
        self._omega = self._spins(start)[0]
        self._angle = self._tooth * np.random.default_rng((seed, self._start_ns)).random(4)
        back = np.divide(self._angle, self._omega, out=np.zeros(4), where=self._omega != 0)
        self._edge_ns = self._start_ns - NS_PER_S * np.minimum(np.abs(back), 1.0)
        self._reported = [0.0] * 4, self._edge_ns.tolist(), self._omega.tolist()
        self._late: deque[tuple[int, Gnss]] = deque()  # arrival and fix
        self._last_ns = self._start_ns - 1
        self._newest: list[Reading] = []
        self._waiting: list[Trajectory] = []  # rows since the last message

    def measure(self, trajectory: Trajectory) -> list[Reading]:
        """Return the messages that arrive during consecutive rows, in order of arrival.

        Rows that were measured before bring what arrived with the last one again.
        """
        if trajectory.stamp_ns[-1] <= self._last_ns:
            return self._newest
        stamps = trajectory.stamp_ns
        is_due = (stamps % self._step_ns == 0) | (stamps == self._start_ns)
        self._last_ns, self._newest = int(stamps[-1]), []
        self._waiting.append(trajectory)
        if not is_due.any():
            return []
        whole, self._waiting = join_trajectories(self._waiting), []
        teeth, edges_ns = self._pass_teeth(whole)
        steers = whole.column('servos.steer.position')
        felt = np.column_stack([whole.column(name) for name in FELT])
        p, readings = self._p, []
        for i in (len(whole.rows) - len(stamps) + np.flatnonzero(is_due)).tolist():
            ns = int(whole.stamp_ns[i])
            arrived = [*self._receive(ns, whole, i)]
            begins = ns == self._start_ns  # with a message of each sensor
            if begins or ns % (p.chassis.period_ms * MS) == 0:
                passed = teeth[i].tolist(), edges_ns[i].tolist()
                arrived.append(self._chassis(ns, float(steers[i]), *passed))
            if begins or ns % (p.imu.period_ms * MS) == 0:
                arrived.append(self._imu(ns, *felt[i].tolist()))
            readings += arrived
            if ns == self._last_ns:
                self._newest = arrived
        return readings

    def _imu(self, ns, ax, ay, phi, theta, r, roll):
        """Measure in the axes of the body: roll phi lifts its left side, pitch theta its rear."""
        n, g = self._normal(OF_IMU, ns, 8), self._gravity
        self._bias = self._bias + self._bias_walk * n[:4]
        true = (
            ax * math.cos(theta) - g * math.sin(theta),
            ay * math.cos(phi) + g * math.sin(phi),
            r,
            roll,
        )
        measured = true + self._bias + self._imu_noise * n[4:]
        return Reading(INERTIAL, Inertial(ns, *measured.tolist()))

    def _chassis(self, ns, steer, teeth, edges_ns):
        p = self._p.chassis
        noise = p.steer_noise_rad * float(self._normal(OF_CHASSIS, ns, 1)[0])
        delta = steer + self._steer_bias + noise
        if p.steer_step_rad:
            delta = p.steer_step_rad * round(delta / p.steer_step_rad)
        wheels = zip(teeth, edges_ns, *self._reported)
        omegas = [self._measure_spin(ns, *wheel) for wheel in wheels]
        self._reported = teeth, edges_ns, omegas
        measured = tuple(omega * scale for omega, scale in zip(omegas, self._spin_scale))
        return Reading(CHASSIS, Chassis(ns, float(delta), measured))

    def _measure_spin(self, ns, teeth, edge_ns, teeth_before, edge_before_ns, omega_before):
        passed = teeth - teeth_before
        if passed:
            return passed * self._tooth / (max(edge_ns - edge_before_ns, 1.0) / NS_PER_S)
        waiting_s = max(ns - edge_ns, 1.0) / NS_PER_S
        if waiting_s >= STANDSTILL_S:
            return 0.0
        most = self._tooth / waiting_s
        return min(max(omega_before, -most), most)

    def _pass_teeth(self, trajectory):
        """Return the teeth that have passed and when the last one did, (n, 4) each."""
        omega = np.vstack([self._omega, self._spins(trajectory)])
        turned = (omega[1:] + omega[:-1]) * 0.5e-3  # the mean of a step, which lasts 1 ms
        if trajectory.stamp_ns[0] == self._start_ns:  # no time passes before the first row
            turned[0] = 0.0
        angle = np.cumsum(np.vstack([self._angle, turned]), axis=0)
        teeth = np.floor(angle / self._tooth)
        step = np.diff(angle, axis=0)
        passed = np.diff(teeth, axis=0) != 0
        edge = self._tooth * np.where(step > 0, teeth[1:], teeth[1:] + 1)
        part = np.divide(edge - angle[:-1], step, out=np.ones_like(step), where=passed)
        times = np.where(passed, (trajectory.stamp_ns[:, None] - MS) + MS * part, -np.inf)
        edges_ns = np.maximum.accumulate(np.vstack([self._edge_ns, times]), axis=0)[1:]
        self._omega, self._angle = omega[-1], angle[-1]
        self._edge_ns = edges_ns[-1]
        return teeth[1:], edges_ns

    def _receive(self, ns, trajectory, i):
        """Take a fix where one is due, and yield those that arrive now."""
        p = self._p.receiver
        latency_ns = p.latency_ms * MS
        if ns == self._start_ns:
            state, back_s = trajectory.state(i), p.latency_ms / 1000
            dX, dY = _to_map(state)
            before = state._replace(X=state.X - dX * back_s, Y=state.Y - dY * back_s)
            self._late.append((ns, self._fix(ns - latency_ns, before)))
        elif ns % (p.period_ms * MS) == 0:
            self._drift = self._next_drift(ns)
            slot = ns // round(p.outage_s * NS_PER_S)
            if self._uniform(OF_OUTAGE, slot) >= p.outage:
                self._late.append((ns + latency_ns, self._fix(ns, trajectory.state(i))))
        while self._late and self._late[0][0] <= ns:
            yield Reading(GNSS, self._late.popleft()[1])

    def _fix(self, ns, state):
        p, n = self._p.receiver, self._normal(OF_RECEIVER, ns, 4)
        dX, dY = _to_map(state)
        position = np.array([state.X, state.Y]) + self._drift + p.position_noise_m * n[:2]
        velocity = np.array([dX, dY]) + p.velocity_noise_mps * n[2:]
        return Gnss(ns, *position.tolist(), *velocity.tolist())

    def _next_drift(self, ns):
        """Return the next value of a Gauss-Markov process of first order."""
        p = self._p.receiver
        kept = math.exp(-p.period_ms / 1000 / p.drift_s)
        # beside those of the fix; recordings have the numbers of the rounded instant
        n = self._normal(OF_RECEIVER, int(float(2**64 - ns)), 2)
        return kept * self._drift + math.sqrt(1 - kept**2) * p.position_drift_m * n

    def _spins(self, trajectory):
        return np.column_stack([trajectory.column(f'wheels.{w}.omega') for w in WHEELS])

    def _normal(self, stream, instant, n):
        return self._seeded(stream, instant).standard_normal(n)

    def _uniform(self, stream, instant):
        return self._seeded(stream, instant).random()

    def _seeded(self, stream, instant):
        """Return the generator, whose next numbers are a function of seed and arguments.

        It is counter-based; another counter costs a tenth of another generator.
        """
        counter = self._philox_state['state']['counter']
        counter[1], counter[2] = stream, instant
        self._generator.bit_generator.state = self._philox_state
        return self._generator


def _to_map(state):
    psi, vx, vy = state.psi, state.vx, state.vy
    return vx * math.cos(psi) - vy * math.sin(psi), vx * math.sin(psi) + vy * math.cos(psi)
