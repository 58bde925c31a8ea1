"""Standard test procedures of the plant: what is driven, and what is evaluated.

A manoeuvre is the group of its settings in config/manoeuvres.yaml, with `runs(case)`, what to
drive, and `numbers(case, tracks)`, what the trajectories of these runs, in their order, come to.
Set-points come every 50 ms, linear in between, as from the controller. Accelerations in the
settings are those of dry road.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from math import ceil, nan
from typing import Annotated, NamedTuple

import numpy as np

from msgs_yaml.types import WHEELS, Command
from node_runtime import parameters
from node_runtime.parameters import Range, Struct
from vehicle_plant.car import PlantParams, split_drive_force
from vehicle_plant.initial_state import Start
from vehicle_plant.linear_single_track import linear_car, yaw_rate_response
from vehicle_plant.parameters import config_file
from vehicle_plant.simulator import START_NS, TICK_NS, Simulator
from vehicle_plant.state import Planar, SetPoints, Trajectory, join_trajectories

Speed = Annotated[float, Range(3.0, 60.0, 'm/s')]
Acceleration = Annotated[float, Range(0.1, 12.0, 'm/s^2')]
Duration = Annotated[float, Range(0.05, 60.0, 's')]
FREQUENCIES = Range(0.02, 8.0, 'Hz')
Share = Annotated[float, Range(0.0, 1.0, '-')]
TICK_S = TICK_NS / 1e9
MS_PER_S = 1000
SLIDING = 0.98  # of the greatest lateral acceleration so far: the car slides for good
FULL_FROM, FULL_TO = 0.8, 0.1  # of the initial speed: the fully developed deceleration
FULL_BRAKE_SHARE = 0.99  # of the brake force
SECOND_PEAK = 0.75  # of the period of a sine
FORMS = {
    'single_track': {'relaxation': False},
    'with_relaxation': {'relaxation': True},
    'with_relaxation_and_body': {'relaxation': True, 'body': True},
}


class Run(NamedTuple):
    """One run of a manoeuvre, from straight rolling."""

    label: str
    speed: float  # m/s at the start
    seconds: float
    law: Callable[[float, float], SetPoints]  # (time at which they are due [s], vx now [m/s])


class Number(NamedTuple):
    """A result."""

    value: float
    unit: str
    meaning: str


class SteadyCircle(Struct):
    """Steady-state circle, ISO 4138: constant speed, steer that increases slowly up to sliding.

    Understeer gradient: slope of delta - L r / V over lateral acceleration.
    """

    speed_mps: Speed
    steer_rate_radps: Annotated[float, Range(0.001, 0.1, 'rad/s')]
    last_steer_rad: Annotated[float, Range(0.01, 1.0, 'rad')]
    fit_from_mps2: Acceleration
    fit_to_mps2: Acceleration

    about = 'understeer gradient on a circle, ISO 4138'

    def runs(self, case: 'Case') -> tuple[Run, ...]:
        """Return the only run."""
        return (self._ramp(case, self.speed_mps),)

    def numbers(self, case: 'Case', tracks: Sequence[Trajectory]) -> dict[str, Number]:
        """Return gradients in the linear range and the limit."""
        V, car = self.speed_mps, linear_car(case.plant, case.friction)
        gripping = tracks[0].where(self._gripping_rows(case, tracks[0]))
        vx, vy, r = (gripping.column(f'planar.{name}') for name in ('vx', 'vy', 'r'))
        ay = gripping.column('acceleration.ay')
        fitted = (ay >= case.scaled(self.fit_from_mps2)) & (ay <= case.scaled(self.fit_to_mps2))

        def slope(y):
            return float(np.polyfit(ay[fitted], y[fitted], 1)[0])

        K = slope(gripping.column('servos.steer.position') - car.wheelbase * r / vx)
        gain = yaw_rate_response(car, V, np.zeros(1), body=True)[0].real
        # r / delta = V / (L + K V^2)
        K_body = 1 / (V * gain) - car.wheelbase / V**2
        characteristic = float(np.sqrt(car.wheelbase / K)) if K > 0 else nan
        unit, single_track = 'rad/(m/s^2)', 'm/L (l_r/C_f - l_f/C_r)'
        return {
            'understeer_gradient': Number(K, unit, 'of the plant in the linear range'),
            'understeer_gradient_single_track': Number(car.understeer, unit, single_track),
            'understeer_gradient_with_body': Number(K_body, unit, 'and roll, load transfer'),
            'characteristic_speed': Number(characteristic, 'm/s', 'sqrt(L / K)'),
            'sideslip_gradient': Number(slope(np.arctan2(vy, vx)), unit, 'at the CoG'),
            'roll_gradient': Number(slope(gripping.column('ride.phi')), unit, 'of the body'),
            'greatest_ay': Number(float(ay.max()), 'm/s^2', 'lateral acceleration at the limit'),
            'slowest': Number(float(vx.min()), 'm/s', 'until then'),
        }

    def steer_at(self, case: 'Case', speed: float, ay: float) -> float:
        """Return the road-wheel angle [rad] for a lateral acceleration at a speed, by such a run.

        Raises ValueError when the car does not reach it.
        """
        track = drive(self._ramp(case, speed), case)
        gripping = track.where(self._gripping_rows(case, track))
        reached = gripping.column('acceleration.ay')
        if reached.max() < ay:
            raise ValueError(f'{reached.max():.2f} m/s^2 at {speed:.1f} m/s, wanted {ay:.2f} m/s^2')
        steer = gripping.column('servos.steer.position')
        return float(np.interp(ay, np.maximum.accumulate(reached), steer))

    def _ramp(self, case, speed):
        settle, hold = case.settings.settle_s, hold_speed(case, speed)

        def law(t, vx):
            steer = np.clip((t - settle) * self.steer_rate_radps, 0.0, self.last_steer_rad)
            return SetPoints(float(steer), *hold(vx))

        seconds = settle + self.last_steer_rad / self.steer_rate_radps
        return Run(f'{speed:.1f} m/s', speed, seconds, law)

    def _gripping_rows(self, case, track):
        """Return the rows from the beginning of steer until the car slides or spins."""
        begin = round(case.settings.settle_s * MS_PER_S)
        ay = track.column('acceleration.ay')
        greatest = np.maximum.accumulate(ay)
        linear = case.scaled(self.fit_to_mps2)
        sliding = np.flatnonzero((greatest > linear) & (ay < SLIDING * greatest))
        end = sliding[0] if len(sliding) else len(ay)
        return slice(begin, begin + int(np.argmax(ay[begin:end])) + 1)


class StepSteer(Struct):
    """Step steer, ISO 7401: lateral transient response; drive force held.

    Times count from the instant at which the road wheels have reached half their angle: response
    time to 90 % of the steady state, peak response time to the peak. Rise time is that from 10 to
    90 %.
    """

    speed_mps: Speed
    ay_mps2: Acceleration
    rise_s: Duration
    seconds: Duration
    steady_from_s: Duration

    about = 'rise time and overshoot after a step, ISO 7401'

    def runs(self, case: 'Case') -> tuple[Run, ...]:
        """Return the only run; its angle is that of the linear single track."""
        car, settle = case.plant.car, case.settings.settle_s
        linear = linear_car(case.plant, case.friction)
        angle = linear.steer(case.scaled(self.ay_mps2), self.speed_mps)
        forces = split_drive_force(car, driving_resistance(car, self.speed_mps))

        def law(t, vx):
            return SetPoints(angle * min(max((t - settle) / self.rise_s, 0.0), 1.0), *forces)

        label = f'{np.degrees(angle):.2f} deg'
        return (Run(label, self.speed_mps, settle + self.seconds, law),)

    def numbers(self, case: 'Case', tracks: Sequence[Trajectory]) -> dict[str, Number]:
        """Return times and overshoots of yaw rate and lateral acceleration."""
        (track,), t = tracks, times(tracks[0])
        is_steady = t >= case.settings.settle_s + self.steady_from_s
        steer = track.column('servos.steer.position')
        steady_steer = float(steer[is_steady].mean())
        half = first_crossing_time(t, steer, 0.5 * steady_steer)
        result = {}
        signals = ('yaw_rate', 'planar.r', 'rad/s'), ('ay', 'acceleration.ay', 'm/s^2')
        for name, column, unit in signals:
            y = track.column(column)
            steady = float(y[is_steady].mean())
            low, high = (first_crossing_time(t, y, share * steady) for share in (0.1, 0.9))
            peak, overshoot = float(t[np.argmax(y)]), float(y.max()) / steady - 1
            result |= {
                f'{name}_steady': Number(steady, unit, 'mean in the steady state'),
                f'{name}_rise_time': Number(high - low, 's', '10 to 90 % of the steady state'),
                f'{name}_response_time': Number(high - half, 's', 'half the steer to 90 %'),
                f'{name}_peak_time': Number(peak - half, 's', 'half the steer to it'),
                f'{name}_overshoot': Number(overshoot, '-', 'of the steady state'),
            }
        gain = result['yaw_rate_steady'].value / steady_steer
        vx = float(track.column('planar.vx')[is_steady].mean())
        result['yaw_rate_gain'] = Number(gain, '1/s', 'steady yaw rate over road-wheel angle')
        result['steady_speed'] = Number(vx, 'm/s', 'mean in the steady state')
        return result


class Sine(NamedTuple):
    """A sine of one frequency."""

    f_hz: float
    begin: float  # s
    evaluated: float  # s, from here on
    end: float  # s
    amplitude: float  # rad


class SineSweep(Struct):
    """Sine sweep, ISO 7401: frequency response from road-wheel angle to yaw rate below 0.2 g.

    One sine after the other, each begun at zero and driven for whole periods. Input and output are
    fitted by a sine of that frequency after settling; the input is the measured road-wheel angle,
    so the servo has no effect.
    """

    speed_mps: Speed
    ay_mps2: Acceleration
    frequencies_hz: Annotated[tuple[float, ...], FREQUENCIES]
    periods: Annotated[int, Range(1, 100, '-')]
    settle_s: Duration
    rigid_up_to_hz: Annotated[float, FREQUENCIES]

    about = 'frequency response against closed forms, ISO 7401'

    def runs(self, case: 'Case') -> tuple[Run, ...]:
        """Return one run with all sines."""
        hold, sequence = hold_speed(case, self.speed_mps), self._sines(case)

        def law(t, vx):
            steer = sum(
                s.amplitude * np.sin(2 * np.pi * s.f_hz * (t - s.begin))
                for s in sequence
                if s.begin <= t < s.end
            )
            return SetPoints(float(steer), *hold(vx))

        return (Run('all frequencies', self.speed_mps, sequence[-1].end, law),)

    def numbers(self, case: 'Case', tracks: Sequence[Trajectory]) -> dict[str, Number]:
        """Return gain and phase at each frequency and the distance to the closed forms."""
        t, result = times(tracks[0]), {}
        f_hz, response = np.array(self.frequencies_hz), []
        signals = tracks[0].column('planar.r'), tracks[0].column('servos.steer.position')
        for s in self._sines(case):
            inside = (t >= s.evaluated) & (t < s.end)
            r, delta = (phasor(t[inside], y[inside], s.f_hz) for y in signals)
            response.append(r / delta)
            gain, phase = abs(response[-1]), float(np.angle(response[-1]))
            result[f'gain_{s.f_hz:g}_hz'] = Number(gain, '1/s', 'yaw rate over road-wheel angle')
            result[f'phase_{s.f_hz:g}_hz'] = Number(phase, 'rad', 'negative: lag')
        car = linear_car(case.plant, case.friction)
        for form, options in FORMS.items():
            closed = yaw_rate_response(car, self.speed_mps, f_hz, **options)
            up_to = max(self.frequencies_hz) if options['relaxation'] else self.rigid_up_to_hz
            ratio = (np.array(response) / closed)[f_hz <= up_to]
            gain, phase = np.abs(np.abs(ratio) - 1).max(), np.abs(np.angle(ratio)).max()
            meaning = f'greatest up to {up_to:g} Hz'
            result[f'gain_error_{form}'] = Number(gain, '-', meaning)
            result[f'phase_error_{form}'] = Number(phase, 'rad', meaning)
        ay = float(np.abs(tracks[0].column('acceleration.ay')).max())
        return result | {'greatest_ay': Number(ay, 'm/s^2', 'lateral acceleration')}

    def _sines(self, case):
        """Return the sines; the linear single track gives the amplitude for the acceleration."""
        car = linear_car(case.plant, case.friction)
        V, ay = self.speed_mps, case.scaled(self.ay_mps2)
        gain = np.abs(yaw_rate_response(car, V, self.frequencies_hz))
        # ay = V r neglects the lateral oscillation: never more steer than in the steady state
        angles = np.minimum(ay / (V * gain), car.steer(ay, V))
        begin, sines = case.settings.settle_s, []
        for f_hz, angle in zip(self.frequencies_hz, angles.tolist()):
            evaluated = begin + ceil(self.settle_s * f_hz) / f_hz
            end = evaluated + self.periods / f_hz
            sines.append(Sine(f_hz, begin, evaluated, end, angle))
            begin = end
        return sines


class StraightBraking(Struct):
    """Straight-line braking to standstill with constant brake forces below the limit (no ABS).

    Closed form: M v' = -(F + k v^2), F = brakes and rolling resistance, k = drag, M = mass with
    the wheels' spin inertia J / R^2, hence from v to standstill s = M / (2 k) ln(1 + k v^2 / F) and
    t = M / sqrt(F k) atan(v sqrt(k / F)); without drag s = M v^2 / (2 F) and t = M v / F. The mean
    fully developed deceleration is that of UN R13-H: from 80 to 10 % of the initial speed.
    """

    speed_mps: Speed
    deceleration_mps2: Acceleration
    front_share: Share
    seconds: Duration

    about = 'stopping distance against the closed form'

    def runs(self, case: 'Case') -> tuple[Run, ...]:
        """Return the only run; it lasts until the car has stood for a while."""
        settle, hold = case.settings.settle_s, hold_speed(case, self.speed_mps)
        forces = self._brake_forces(case)

        def law(t, vx):
            return SetPoints(0.0, *(forces if t > settle else hold(vx)))

        _, duration = self.to_standstill(case, self.speed_mps)
        label = f'{case.scaled(self.deceleration_mps2):g} m/s²'
        return (Run(label, self.speed_mps, settle + max(self.seconds, 1.5 * duration), law),)

    def numbers(self, case: 'Case', tracks: Sequence[Trajectory]) -> dict[str, Number]:
        """Return distances of the plant and of the closed form, and the deceleration."""
        settle_s, column, t = case.settings.settle_s, tracks[0].column, times(tracks[0])
        X, vx = column('planar.X'), column('planar.vx')
        begin = round(settle_s * MS_PER_S)
        force = column('servos.front.position') + column('servos.rear.position')
        wanted = sum(self._brake_forces(case))
        full = int(np.flatnonzero(force > FULL_BRAKE_SHARE * wanted)[-1]) + 1
        end = int(np.flatnonzero(vx <= 0)[0])  # stands
        high, low = FULL_FROM * self.speed_mps, FULL_TO * self.speed_mps
        X_high, X_low = (float(np.interp(-v, -vx[full:end], X[full:end])) for v in (high, low))
        mean = (high**2 - low**2) / (2 * (X_low - X_high))
        distance = X[end] - X[full]
        expected, _ = self.to_standstill(case, vx[full])
        creep = np.abs(vx[t > t[-1] - settle_s]).max()
        slip = max(-column(f'wheels.{w}.kappa')[full:end].min() for w in WHEELS)
        return {
            'stopping_distance': Number(float(X[end] - X[begin]), 'm', 'from the brake command'),
            'stopping_time': Number(float(t[end] - t[begin]), 's', 'from the brake command'),
            'full_braking_distance': Number(float(distance), 'm', 'from the full brake force'),
            'full_braking_closed_form': Number(expected, 'm', 'M / (2 k) ln(1 + k v^2 / F)'),
            'distance_error': Number(float(distance / expected - 1), '-', 'plant over closed form'),
            'mean_full_deceleration': Number(mean, 'm/s^2', '80 to 10 % of the speed'),
            'creep': Number(float(creep), 'm/s', 'speed left while standing'),
            'greatest_slip': Number(float(slip), '-', 'of any wheel'),
        }

    def _brake_forces(self, case):
        return brake_forces(case, self.deceleration_mps2, self.front_share)

    def to_standstill(self, case: 'Case', v: float) -> tuple[float, float]:
        """Return distance [m] and time [s] from a speed [m/s] to standstill by the closed form."""
        car = case.plant.car
        body, wheel = car.body, car.wheel
        M = body.mass_kg + len(WHEELS) * wheel.spin_inertia_kgm2 / wheel.radius_m**2
        F = -sum(self._brake_forces(case)) + driving_resistance(car, 0.0)
        # without drag the limit of k to 0, which this is to the last digits
        k = max(body.air_density_kgpm3 / 2 * body.drag_area_m2, 1e-12)
        distance = M / (2 * k) * np.log1p(k * v**2 / F)
        return float(distance), float(M / np.sqrt(F * k) * np.arctan(v * np.sqrt(k / F)))


class TurnBraking(Struct):
    """Braking in a turn, ISO 7975: from a steady circle, brakes at several levels, steering held.

    Evaluated some time after the brakes: yaw rate over that of the initial radius at the present
    speed, r / (V / R); above 1 the car turns in, below 1 it runs wide. Also side slip, distance of
    the CoG outside its circle, and whether a wheel locks: the car has no ABS.
    """

    radius_m: Annotated[float, Range(10.0, 1000.0, 'm')]
    ay_mps2: Acceleration
    decelerations_mps2: Annotated[tuple[float, ...], Range(0.1, 12.0, 'm/s^2')]
    front_share: Share
    steer_rise_s: Duration
    circle_s: Duration
    seconds: Duration
    judged_s: Duration

    about = 'brakes on a circle, steering held, ISO 7975'

    def runs(self, case: 'Case') -> tuple[Run, ...]:
        """Return one run per level of braking."""
        settle, ay = case.settings.settle_s, case.scaled(self.ay_mps2)
        speed = float(np.sqrt(ay * self.radius_m))
        angle = case.settings.steady_circle.steer_at(case, speed, ay)
        hold, brake_s = hold_speed(case, speed), settle + self.steer_rise_s + self.circle_s

        def braking(deceleration):
            forces = brake_forces(case, deceleration, self.front_share)

            def law(t, vx):
                steer = angle * min(max((t - settle) / self.steer_rise_s, 0.0), 1.0)
                return SetPoints(steer, *(forces if t > brake_s else hold(vx)))

            return law

        seconds = brake_s + self.seconds
        return tuple(
            Run(f'{case.scaled(a):g} m/s²', speed, seconds, braking(a))
            for a in self.decelerations_mps2
        )

    def numbers(self, case: 'Case', tracks: Sequence[Trajectory]) -> dict[str, Number]:
        """Return the evaluation at each level of braking."""
        brake_s = case.settings.settle_s + self.steer_rise_s + self.circle_s
        before = round(brake_s * MS_PER_S) - 1  # row
        result = {}
        for level, track in zip(self.decelerations_mps2, tracks):
            t, column = times(track) - brake_s, track.column
            X, Y, psi, vx, vy, r = (column(f'planar.{name}') for name in Planar._fields)
            V, beta = np.hypot(vx, vy), np.arctan2(vy, vx)
            R, heading = V[before] / r[before], psi[before] + beta[before]
            # distance of the CoG outside the circle around (X0, Y0)
            X0, Y0 = X[before] - R * np.sin(heading), Y[before] + R * np.cos(heading)
            outside, ratio = np.hypot(X - X0, Y - Y0) - abs(R), r * R / V
            if not result:
                ay, initial_speed = float(column('acceleration.ay')[before]), float(V[before])
                result = {
                    'initial_radius': Number(float(R), 'm', 'V / r before the brakes'),
                    'initial_ay': Number(ay, 'm/s^2', 'lateral acceleration before the brakes'),
                }
            within = (t > 0) & (t <= self.judged_s)
            slip = float(-min(column(f'wheels.{w}.kappa')[within].min() for w in WHEELS))
            speed, judged_ratio, judged_beta, judged_outside = (
                float(np.interp(self.judged_s, t, y)) for y in (V, ratio, beta, outside)
            )
            mean, greatest = (initial_speed - speed) / self.judged_s, float(ratio[within].max())
            label = f'{case.scaled(level):g} m/s²'
            when = f'{self.judged_s:g} s after braking with {label} begins'
            result |= {
                f'mean_deceleration_at_{level:g}': Number(mean, 'm/s^2', f'over the {when}'),
                f'yaw_rate_ratio_at_{level:g}': Number(judged_ratio, '-', when),
                f'sideslip_at_{level:g}': Number(judged_beta, 'rad', when),
                f'outside_at_{level:g}': Number(judged_outside, 'm', when),
                f'greatest_yaw_rate_ratio_at_{level:g}': Number(greatest, '-', f'within {when}'),
                f'greatest_brake_slip_at_{level:g}': Number(slip, '-', 'of any wheel till then'),
            }
        return result


class SineWithDwell(Struct):
    """Sine with dwell after FMVSS 126 (49 CFR 571.126, S5.2, S7): stability and agility; coasting.

    The rule is written for cars with electronic stability control; this car has none, so large
    amplitudes may fail it: the numbers include the greatest amplitude that passes.
    """

    speed_mps: Speed
    frequency_hz: Annotated[float, Range(0.1, 5.0, 'Hz')]
    dwell_s: Duration
    unit_ay_mps2: Acceleration
    amplitudes: Annotated[tuple[float, ...], Range(0.1, 20.0, '-')]
    seconds: Duration
    displaced_s: Duration
    displacement_m: Annotated[float, Range(0.0, 20.0, 'm')]
    displaced_from: Annotated[float, Range(0.1, 20.0, '-')]
    early_s: Duration
    early_ratio: Share
    late_s: Duration
    late_ratio: Share

    about = 'stability and agility, FMVSS 126'

    def runs(self, case: 'Case') -> tuple[Run, ...]:
        """Return one run per amplitude; the unit is the plant's own steer for 0.3 g."""
        settle, ay = case.settings.settle_s, case.scaled(self.unit_ay_mps2)
        unit = case.settings.steady_circle.steer_at(case, self.speed_mps, ay)
        seconds = settle + 1 / self.frequency_hz + self.dwell_s + self.seconds

        def steering(amplitude):
            return lambda t, vx: SetPoints(amplitude * unit * self.waveform(t - settle), 0.0, 0.0)

        return tuple(Run(f'{a:g}', self.speed_mps, seconds, steering(a)) for a in self.amplitudes)

    def waveform(self, t: float) -> float:
        """Return the steer over its amplitude, t [s] since the beginning of steer."""
        peak, end = SECOND_PEAK / self.frequency_hz, 1 / self.frequency_hz + self.dwell_s
        if not 0 <= t < end:
            return 0.0
        phase = t if t <= peak else max(peak, t - self.dwell_s)
        return float(np.sin(2 * np.pi * self.frequency_hz * phase))

    def numbers(self, case: 'Case', tracks: Sequence[Trajectory]) -> dict[str, Number]:
        """Return the three criteria at each amplitude, and up to which one all are met.

        They are the remaining yaw rate over its peak, early and late, and the displacement. The
        peak is the greatest yaw rate after the steer has changed its sign.
        """
        early_text = f'of its peak, {self.early_s:g} s after steer, <= {self.early_ratio:g}'
        late_text = f'of its peak, {self.late_s:g} s after steer, <= {self.late_ratio:g}'
        displacement_text = f'{self.displaced_s:g} s into steer, >= {self.displacement_m:g}'
        reversal = 1 / (2 * self.frequency_hz)
        done = 1 / self.frequency_hz + self.dwell_s
        result, passed, all_passed = {}, 0.0, True
        for amplitude, track in zip(self.amplitudes, tracks):
            t, r = times(track) - case.settings.settle_s, track.column('planar.r')
            peak = r[(t > reversal) & (t < done + self.early_s)].min()
            instants = [done + self.early_s, done + self.late_s]
            early, late = (np.interp(instants, t, r) / peak).tolist()
            displacement = float(np.interp(self.displaced_s, t, track.column('planar.Y')))
            is_agile = amplitude < self.displaced_from or displacement >= self.displacement_m
            is_stable = early <= self.early_ratio and late <= self.late_ratio
            all_passed = all_passed and is_stable and is_agile
            passed = amplitude if all_passed else passed
            result |= {
                f'yaw_rate_left_early_at_{amplitude:g}': Number(early, '-', early_text),
                f'yaw_rate_left_late_at_{amplitude:g}': Number(late, '-', late_text),
                f'displacement_at_{amplitude:g}': Number(displacement, 'm', displacement_text),
            }
        unit = float(tracks[0].column('servos.steer.position').max()) / self.amplitudes[0]
        result['unit_steer'] = Number(unit, 'rad', 'road-wheel angle of amplitude 1, as reached')
        result['passed_up_to'] = Number(passed, '-', 'amplitude up to which all criteria are met')
        return result


class Settings(Struct):
    """All manoeuvres, and what they share."""

    settle_s: Duration
    speed_gain_nspm: Annotated[float, Range(0.0, 50e3, 'N s/m')]
    steady_circle: SteadyCircle
    step_steer: StepSteer
    sine_sweep: SineSweep
    straight_braking: StraightBraking
    turn_braking: TurnBraking
    sine_with_dwell: SineWithDwell


class Case(NamedTuple):
    """A car on a road, and the settings of the manoeuvres."""

    plant: PlantParams
    friction: float  # of the road relative to the tyre's test surface
    settings: Settings

    def scaled(self, acceleration: float) -> float:
        """Return an acceleration of dry road scaled to this road [m/s^2]."""
        return acceleration * min(self.friction, 1.0)


class Driven(NamedTuple):
    """A manoeuvre that was driven."""

    case: Case
    runs: tuple[Run, ...]
    tracks: list[Trajectory]
    numbers: dict[str, Number]


def load_settings() -> Settings:
    """Read config/manoeuvres.yaml. Raises ParameterError."""
    return parameters.load(Settings, config_file('manoeuvres.yaml'))


def perform(name: str, case: Case) -> Driven:
    """Drive the manoeuvre of this name and evaluate it. Raises ValueError."""
    manoeuvre = getattr(case.settings, name)
    runs = manoeuvre.runs(case)
    tracks = [drive(run, case) for run in runs]
    return Driven(case, runs, tracks, manoeuvre.numbers(case, tracks))


def drive(run: Run, case: Case) -> Trajectory:
    """Return the trajectory of a run, one row per millisecond, the first at 1 ms.

    Raises RefusedError when the gate of the plant refuses a command.
    """
    # a law may ask an axle for more than it gives: its servo and its tyres limit that
    gate = replace(case.plant.car.gate, force_tolerance_n=np.inf, friction_use=np.inf)
    plant = replace(case.plant, car=replace(case.plant.car, gate=gate))
    car = Simulator(plant, case.friction, Start(0.0, 0.0, 0.0, run.speed))
    vx, pieces = run.speed, []
    for tick in range(1, round(run.seconds / TICK_S) + 1):
        delta, *forces = run.law(tick * TICK_S, vx)
        pieces.append(car.follow(Command(car.stamp_ns, delta, 0.0, *forces)))
        vx = pieces[-1].column('planar.vx')[-1]
    return join_trajectories(pieces)


def times(track: Trajectory) -> np.ndarray:
    """Return the time of each row since the start [s]."""
    return (track.stamp_ns - START_NS) / 1e9


def hold_speed(case: Case, speed: float) -> Callable[[float], tuple[float, float]]:
    """Return a law vx -> front and rear axle force [N] that holds a speed.

    The law raises ValueError for a car without an engine.
    """
    car = case.plant.car
    resistance, gain = driving_resistance(car, speed), case.settings.speed_gain_nspm
    return lambda vx: split_drive_force(car, resistance + gain * (speed - vx))


def driving_resistance(car, speed: float) -> float:
    """Return drag and rolling resistance on a straight level road [N]."""
    body = car.body
    drag = body.air_density_kgpm3 / 2 * body.drag_area_m2 * speed**2
    return drag + car.wheel.rolling_resistance * body.mass_kg * body.gravity_mps2


def brake_forces(case: Case, deceleration: float, front_share: float) -> tuple[float, float]:
    """Return the axle forces for a deceleration [N], negative."""
    total = -case.plant.car.body.mass_kg * case.scaled(deceleration)
    return front_share * total, (1 - front_share) * total


def first_crossing_time(t: np.ndarray, y: np.ndarray, level: float) -> float:
    """Return the instant at which y first reaches a positive level; nan when it never does."""
    above = np.flatnonzero(y >= level)
    if not len(above):
        return nan
    i = above[0]
    if i == 0:
        return float(t[0])
    return float(np.interp(level, y[i - 1 : i + 1], t[i - 1 : i + 1]))


def phasor(t: np.ndarray, y: np.ndarray, f_hz: float) -> complex:
    """Return the complex amplitude of exp(2 pi i f t) in y, apart from a constant and a drift."""
    phase = 2 * np.pi * f_hz * t
    terms = np.column_stack([np.cos(phase), np.sin(phase), np.ones_like(t), t - t.mean()])
    (cosine, sine, _, _), *_ = np.linalg.lstsq(terms, y, rcond=None)
    return complex(cosine, -sine)
