"""Settings of the manoeuvres: config/manoeuvres.yaml."""

from typing import Annotated

from node_runtime import parameters
from node_runtime.parameters import Range, Struct
from vehicle_plant.parameters import config_file

Speed = Annotated[float, Range(3.0, 60.0, 'm/s')]
Acceleration = Annotated[float, Range(0.1, 12.0, 'm/s^2')]
Duration = Annotated[float, Range(0.05, 60.0, 's')]
FREQUENCIES = Range(0.02, 8.0, 'Hz')
Share = Annotated[float, Range(0.0, 1.0, '-')]


class FromSpeed(Struct):
    """A manoeuvre that begins at a constant speed, straight ahead."""

    speed_mps: Speed


class SteadyCircle(FromSpeed):
    """Constant speed, slowly increasing steer."""

    steer_rate_radps: Annotated[float, Range(0.001, 0.1, 'rad/s')]
    last_steer_rad: Annotated[float, Range(0.01, 1.0, 'rad')]
    fit_from_mps2: Acceleration
    fit_to_mps2: Acceleration


class StepSteer(FromSpeed):
    """Steer in one step, drive force held."""

    ay_mps2: Acceleration
    rise_s: Duration
    seconds: Duration
    steady_from_s: Duration


class SineSweep(FromSpeed):
    """Sines of small amplitude, one after the other."""

    ay_mps2: Acceleration
    frequencies_hz: Annotated[tuple[float, ...], FREQUENCIES]
    periods: Annotated[int, Range(1, 100, '-')]
    settle_s: Duration
    rigid_up_to_hz: Annotated[float, FREQUENCIES]


class StraightBraking(FromSpeed):
    """Constant brake forces to standstill."""

    deceleration_mps2: Acceleration
    front_share: Share
    seconds: Duration


class TurnBraking(Struct):
    """Brakes on a circle, steering held."""

    radius_m: Annotated[float, Range(10.0, 1000.0, 'm')]
    ay_mps2: Acceleration
    decelerations_mps2: Annotated[tuple[float, ...], Range(0.1, 12.0, 'm/s^2')]
    front_share: Share
    steer_rise_s: Duration
    circle_s: Duration
    seconds: Duration
    judged_s: Duration


class SineWithDwell(FromSpeed):
    """One sine that rests at its second peak; coasting."""

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


class Settings(Struct):
    """Settings of all manoeuvres."""

    settle_s: Duration
    speed_gain_nspm: Annotated[float, Range(0.0, 50e3, 'N s/m')]
    steady_circle: SteadyCircle
    step_steer: StepSteer
    sine_sweep: SineSweep
    straight_braking: StraightBraking
    turn_braking: TurnBraking
    sine_with_dwell: SineWithDwell


def load() -> Settings:
    """Read config/manoeuvres.yaml. Raises ParameterError."""
    return parameters.load(Settings, config_file('manoeuvres.yaml'))
