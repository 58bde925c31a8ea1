"""Extended Kalman filter of the motion of a car, from IMU, wheel speeds, steering and receiver.

States: X, Y, psi [m, rad], vx, vy [m/s], biases of ax, ay [m/s^2] and of the yaw rate [rad/s], and
the friction of the road [-, of the identified one]. The IMU is integrated; what bounds its drift:

    tyres        with both axle forces known from ay and the yaw acceleration, the tyre model says
                 the sideslip of each axle where it does not slide, and the friction where it does
    wheels       speed over ground but for the slip that the longitudinal acceleration needs
    receiver     position and velocity, which fuse late (`kalman`)
    standstill   zero velocity and yaw rate

The equations are those of a single-track car, as in Baffet, Charara, Lechner, Control Engineering
Practice 17 (2009); tyres are of Fiala. Errors of the tyre model last for tenths of a second: white
noise of the same spectral density at zero frequency stands for them. SI units, ISO 8855 axes.
"""

import math
from bisect import bisect_left
from collections import deque

import numpy as np

from msgs_yaml.conversions import NS_PER_S, wrap_angle
from msgs_yaml.types import Chassis, Gnss, SensorReading, VehicleState
from state_estimator import vehicle_model
from state_estimator.estimate import DIVERGED, OK, Estimate
from state_estimator.kalman import Instant, correct_late
from state_estimator.parameters import EstimatorParams, Vehicle
from state_estimator.vehicle_model import G, RestDetector

N = 9
X, Y, PSI, VX, VY, B_AX, B_AY, B_R, MU = range(N)
REPORTED = X, Y, PSI, VX, VY, B_R
REPORTED_AT = np.add.outer(N * np.array(REPORTED), REPORTED)  # places in the flat covariance
SLOW_MPS, CRAWL_MPS = 4.0, 1.0  # below them: no slip; no course
FIX_LATE_S, LATE_NS = 1.0, 100_000_000  # a receiver is silent; an angle is too old
# what a car that drives may have done since the fix from which the filter begins anew
ANEW_MPS2, ANEW_SIDESLIP_RAD = 5.0, 0.1
MU_RANGE = 0.1, 1.3
HISTORY_S = 0.6  # a fix that is older is not used
LARGEST_OFFSET_NS = 20_000_000  # of a fix from the nearest message of the IMU
LONGEST_STEP_S = 0.1  # a longer pause of the IMU begins the filter anew
_I = np.eye(N)


class Filter:
    """The filter; `update` takes messages in the order of their arrival."""

    def __init__(self, params: EstimatorParams, vehicle: Vehicle, yaw_rad: float | None = None):
        """Begin without a state; `yaw_rad` is the heading where the car starts at rest."""
        self._p, self._car, self._yaw = params, vehicle, yaw_rad
        self._axles, self._wheels = vehicle_model.axles(vehicle), vehicle_model.wheels(vehicle)
        self._pitch = 1.0 + G * vehicle.pitch_radps2  # of ax as it is measured, gravity in it
        p, white = params, params.acceleration_noise**2
        pose, bias = p.position_walk**2, p.acceleration_walk**2
        lengthways, across = white + p.pitch_noise**2, white + p.roll_noise**2
        mu = 2.0 * p.friction_spread**2 / p.friction_time_s
        noise = [pose, pose, p.rate_noise**2, lengthways, across, bias, bias, p.rate_walk**2, mu]
        self._noise = np.array(noise)  # per second
        drift, rate = p.position_drift_m**2, p.rate_noise**2 / p.imu_s
        self._reported_noise = np.diag([drift, drift, 0.0, 0.0, 0.0, rate])
        self._chassis: Chassis | None = None
        self._fix: Gnss | None = None
        self.resets, self.reason = 0, ''  # why it began anew the last time
        self._begin()

    def _begin(self):
        self._now: Instant | None = None
        self._past: deque[Instant] = deque()
        self._imu = None
        self._fix_ns = self._misfits = 0
        self._rest = RestDetector()
        self._phi = self._r_slow = self._ay_slow = 0.0
        self._alpha = [0.0, 0.0]

    def _begin_anew(self, reason):
        """Forget the state but for the heading, which nothing tells of a car at rest."""
        if self._now and math.isfinite(self._now.x[PSI]):
            self._yaw = float(self._now.x[PSI])
        self._begin()
        self.resets, self.reason = self.resets + 1, reason

    def update(self, message: SensorReading) -> Estimate | None:
        """Take a message; return the estimate after one of the IMU, once there is a state."""
        use = {Chassis: self._on_chassis, Gnss: self._on_fix}.get(type(message), self._on_imu)
        return use(message)

    def _start(self, imu):
        """Begin at the newest fix, moved on by its velocity; a car that moves looks ahead.

        A drive begins at constant velocity; later the car may have braked since, and slides.
        """
        p, fix = self._p, self._fix
        since = (imu.stamp_ns - fix.stamp_ns) / NS_PER_S
        if since > FIX_LATE_S:
            return
        changed, slide = ANEW_MPS2 * since, ANEW_SIDESLIP_RAD
        if not self.resets:
            changed, slide = 0.0, p.start_sideslip_rad
        velocity = math.hypot(p.velocity_noise_mps, changed)
        speed = math.hypot(fix.vX, fix.vY)
        psi, sd = math.atan2(fix.vY, fix.vX), velocity / max(speed, CRAWL_MPS)
        if speed < CRAWL_MPS:
            if self._yaw is None:
                return
            psi, speed = self._yaw, 0.0
            sd = ANEW_SIDESLIP_RAD if self.resets else p.start_yaw_rad
        self._now = now = Instant(imu.stamp_ns, N)
        now.x[[X, Y]] = fix.X + since * fix.vX, fix.Y + since * fix.vY
        now.x[[PSI, VX, MU]] = psi, speed, p.friction
        at = math.hypot(p.position_noise_m, p.position_drift_m, 0.5 * changed * since)
        sds = [at, at, sd, velocity, velocity]
        sds += [*[p.acceleration_bias_mps2] * 2, p.rate_bias_radps, p.friction_spread]
        now.P[:] = np.diag(np.square(sds))
        # the course is known: what turns the heading turns the velocity against the body
        slide *= speed > 0.0
        now.P[PSI, PSI] += slide**2
        now.P[VY, VY] += (slide * speed) ** 2
        now.P[PSI, VY] = now.P[VY, PSI] = -speed * slide**2
        self._fix_ns, self._r_slow, self._ay_slow = fix.stamp_ns, imu.r, imu.ay

    def _on_imu(self, imu):
        before = self._imu
        dt = (imu.stamp_ns - before.stamp_ns) / NS_PER_S if before else 0.0
        if self._now and not 0.0 < dt <= LONGEST_STEP_S:
            self._begin_anew(f'{dt:.3f} s between two messages of the IMU')
        self._imu = imu
        if not self._now:
            if self._fix and self._chassis:
                self._start(imu)
            return self._estimate(imu) if self._now else None
        self._past.append(self._now)
        while self._past[0].stamp_ns < imu.stamp_ns - HISTORY_S * NS_PER_S:
            self._past.popleft()
        self._now = self._predict(before, imu, dt)
        self._use_tyres(imu, dt)
        return self._estimate(imu)

    def _predict(self, before, imu, dt):
        """Integrate the IMU over a step, trapezoidal in its readings; return the next instant."""
        p = self._p
        at_X, at_Y, psi, vx, vy, b_ax, b_ay, b_r, mu = self._now.x.tolist()
        roll = self._roll(imu, dt, b_ay)
        r = 0.5 * (before.r + imu.r) - b_r
        ax = (0.5 * (before.ax + imu.ax) - b_ax) / self._pitch
        ay = 0.5 * (before.ay + imu.ay) - b_ay - G * roll
        middle = psi + 0.5 * r * dt
        c, s = math.cos(middle), math.sin(middle)
        vX, vY = vx * c - vy * s, vx * s + vy * c
        pull = math.exp(-dt / p.friction_time_s)
        x = (
            at_X + dt * vX, at_Y + dt * vY, psi + dt * r, vx + dt * (ax + r * vy),
            vy + dt * (ay - r * vx), b_ax, b_ay, b_r, p.friction + pull * (mu - p.friction),
        )  # fmt: skip
        F = _I.copy()
        F[X, PSI], F[X, VX], F[X, VY] = -dt * vY, dt * c, -dt * s
        F[Y, PSI], F[Y, VX], F[Y, VY] = dt * vX, dt * s, dt * c
        F[PSI, B_R] = -dt
        F[VX, VY], F[VX, B_AX], F[VX, B_R] = r * dt, -dt, -vy * dt
        F[VY, VX], F[VY, B_AY], F[VY, B_R] = -r * dt, -dt, vx * dt
        F[MU, MU] = pull
        variances = dt * self._noise
        variances[VY] += dt * (p.roll_noise * ay) ** 2
        return self._now.next(imu.stamp_ns, x, F, variances)

    def _roll(self, imu, dt, b_ay):
        """Return the roll angle: its rate, drawn to what the lateral acceleration leads to."""
        steady = self._car.roll_radps2 * (imu.ay - b_ay - G * self._phi)
        pull = dt / self._p.roll_time_s
        self._phi += dt * imu.p + pull * (steady - self._phi)
        return self._phi

    def _use_tyres(self, imu, dt):
        """Compare the axle forces that the IMU says with those of the tyres."""
        p, car, now = self._p, self._car, self._now
        *_, vx, vy, b_ax, _, b_r, _ = now.x.tolist()
        r = imu.r - b_r
        ay = imu.ay - G * self._phi
        slow = dt / (p.force_time_s + dt)
        self._ay_slow += slow * (ay - self._ay_slow)
        yaw_acceleration = (imu.r - self._r_slow) / (p.force_time_s + dt)
        self._r_slow += slow * (imu.r - self._r_slow)
        delta = self._chassis.delta
        if vx < SLOW_MPS:
            if abs(vx) < SLOW_MPS and not self._stands(imu):  # the rear axle does not slip
                variance = 0.1**2 + (0.2 * ay) ** 2
                self._correct({VY: 1.0, B_R: car.rear_m}, car.rear_m * r - vy, variance)
            return
        ax = (imu.ax - b_ax) / self._pitch
        turned = yaw_acceleration * car.yaw_inertia_kgm2 / car.mass_kg
        lag = p.force_time_s + car.relaxation_m / vx
        density = 2.0 * p.tyre_time_s / dt
        for k, axle in enumerate(self._axles):
            across = vy + axle.arm * r
            tan_alpha = across / vx - delta * axle.steered
            self._alpha[k] += dt / (lag + dt) * (tan_alpha - self._alpha[k])
            if axle.steered and self._chassis_is_late(imu):
                continue
            force, slope, over_friction = axle.force(self._alpha[k], ax, float(now.x[MU]))
            h = {VX: -slope * across / vx**2, VY: slope / vx, B_R: -slope * axle.arm / vx}
            h |= {B_AY: 1.0, MU: over_friction}
            lateral = self._ay_slow + turned / axle.other
            sd = p.tyre_noise_mps2 + p.tyre_error * abs(lateral) + abs(slope) * p.steer_error_rad
            self._correct(h, lateral - float(now.x[B_AY]) - force, density * sd**2)

    def _on_chassis(self, chassis):
        self._chassis = chassis
        if not self._now:
            return
        p, car, imu, now = self._p, self._car, self._imu, self._now
        if self._stands(imu):
            for index, value in ((VX, 0.0), (VY, 0.0), (B_R, imu.r), (B_AX, imu.ax)):
                sd = 0.02 if index in (VX, VY) else 0.3 if index == B_AX else 0.01
                self._correct({index: 1.0}, value - now.x[index], sd**2)
            return
        *_, b_ax, _, b_r, _ = now.x.tolist()
        r, ax = imu.r - b_r, (imu.ax - b_ax) / self._pitch
        c_front, s_front = math.cos(chassis.delta), math.sin(chassis.delta)
        for wheel, omega in zip(self._wheels, chassis.omega):
            c, s = (c_front, s_front) if wheel.steered else (1.0, 0.0)
            vx, vy = now.x[VX : VY + 1].tolist()
            speed = (vx - wheel.y * r) * c + (vy + wheel.x * r) * s
            slip = car.slip_per_mps2 * ax * (ax < 0.0 or wheel.driven)
            sd = p.wheel_noise_mps + (p.wheel_error + p.slip_error * abs(slip)) * abs(speed)
            innovation = omega * car.wheel_radius_m - speed * (1.0 + slip)
            if not abs(innovation) <= 4.0 * math.sqrt(sd**2 + now.P[VX, VX]):
                continue  # it locks, spins or says nothing
            h = {VX: c, VY: s, B_R: wheel.y * c - wheel.x * s}
            self._correct(h, innovation, sd**2 * 2.0 * p.wheel_time_s / p.chassis_s)

    def _chassis_is_late(self, imu):
        return imu.stamp_ns - self._chassis.stamp_ns > LATE_NS

    def _stands(self, imu):
        return self._rest.update(imu, self._chassis, self._now.x[B_AX], self._now.x[B_R])

    def _on_fix(self, fix):
        self._fix = fix
        if not self._now:
            return
        instants = [*self._past, self._now]
        after = bisect_left(instants, fix.stamp_ns, key=lambda instant: instant.stamp_ns)
        near = range(len(instants))[max(after - 1, 0) : after + 1]
        at = min(near, key=lambda i: abs(instants[i].stamp_ns - fix.stamp_ns))
        then = instants[at]
        if abs(then.stamp_ns - fix.stamp_ns) > LARGEST_OFFSET_NS:
            return
        p, (at_X, at_Y, psi, vx, vy, *_) = self._p, then.x.tolist()
        c, s = math.cos(psi), math.sin(psi)
        vX, vY = vx * c - vy * s, vx * s + vy * c
        H = np.zeros((4, N))
        H[0, X] = H[1, Y] = 1.0
        H[2, PSI], H[2, VX], H[2, VY] = -vY, c, -s
        H[3, PSI], H[3, VX], H[3, VY] = vX, s, c
        drift = p.position_drift_m**2 * 2.0 * p.drift_time_s / p.fix_s
        R = np.array([*[p.position_noise_m**2 + drift] * 2, *[p.velocity_noise_mps**2] * 2])
        innovation = np.array([fix.X - at_X, fix.Y - at_Y, fix.vX - vX, fix.vY - vY])
        S = H.dot(then.P).dot(H.T)
        S.flat[::5] += R
        misfit = float(innovation @ np.linalg.solve(S, innovation))
        self._misfits = self._misfits + 1 if misfit > p.misfit else 0
        if self._misfits:
            if self._misfits > p.misfits:
                self._begin_anew('the receiver stays elsewhere')
            return
        self._fix_ns = fix.stamp_ns
        correct_late(instants[at:], H, S, innovation)
        self._bound_friction()

    def _correct(self, derivatives, innovation, R):
        """Use a measurement by its derivatives with respect to the states that it depends on."""
        h = np.zeros(N)
        for state, derivative in derivatives.items():
            h[state] = derivative
        self._now.correct(h, innovation, R)
        self._bound_friction()

    def _bound_friction(self):
        self._now.x[MU] = min(max(self._now.x[MU], MU_RANGE[0]), MU_RANGE[1])

    def _estimate(self, imu):
        now = self._now
        x, variances = now.x.tolist(), now.P.diagonal().tolist()
        if not (math.isfinite(sum(x) + sum(variances)) and min(variances) >= 0.0):
            self._begin_anew('the state was no number, or a variance below 0')
            self._imu = imu
            self._start(imu)
            return self._estimate(imu) if self._now else None
        state = VehicleState(
            imu.stamp_ns, x[X], x[Y], wrap_angle(x[PSI]), x[VX], x[VY], imu.r - x[B_R]
        )
        P = now.P.take(REPORTED_AT)
        P[5] *= -1.0  # the yaw rate is that of the IMU less its bias
        P[:, 5] *= -1.0
        P += self._reported_noise
        missing = ['receiver'] if imu.stamp_ns - self._fix_ns > FIX_LATE_S * NS_PER_S else []
        missing += ['chassis'] if self._chassis_is_late(imu) else []
        status = DIVERGED if self._misfits > 2 else OK
        status = f'no {" and ".join(missing)}' if missing else status
        return Estimate(state, P, x[MU], status)
