"""Every manoeuvre by its name."""

from vehicle_plant.manoeuvres import (
    sine_sweep,
    sine_with_dwell,
    steady_circle,
    step_steer,
    straight_braking,
    turn_braking,
)
from vehicle_plant.manoeuvres.course import Manoeuvre


def _of(module, about: str) -> Manoeuvre:
    return Manoeuvre(about, module.runs, module.numbers, module.draw)


MANOEUVRES = {
    'steady_circle': _of(steady_circle, 'understeer gradient on a circle, ISO 4138'),
    'step_steer': _of(step_steer, 'rise time and overshoot after a step, ISO 7401'),
    'sine_sweep': _of(sine_sweep, 'frequency response against closed forms, ISO 7401'),
    'straight_braking': _of(straight_braking, 'stopping distance against the closed form'),
    'turn_braking': _of(turn_braking, 'brakes on a circle, steering held, ISO 7975'),
    'sine_with_dwell': _of(sine_with_dwell, 'stability and agility, FMVSS 126'),
}
