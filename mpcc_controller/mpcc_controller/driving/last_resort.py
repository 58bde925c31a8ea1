"""After an internal error: it is counted, and the tick that raised commands to brake.

SI units, ISO 8855.

Whatever a tick calls may be what failed, so this shares no function with it, only numbers. The law
is that of `braking`, simplified: both axles use the same share of their friction, as the loads are
under that braking, and the friction circle of the weaker one holds for the car.
"""

import math
from collections import Counter
from pathlib import Path

import numpy as np

from mpcc_controller.model.single_track import Car
from mpcc_controller.parameters import Braking, Limits
from msgs_yaml.types import Command, VehicleState

GRAVITY = 9.81  # m/s^2
SLOW_MPS = 5.0  # slip angles are not taken with less
INTERNAL_ERROR = 'internal_error'  # the reason of a tick that raised; in diagnostics, which error


class InternalErrors:
    """Counts exceptions by their kind: their type, and the line that raised them."""

    def __init__(self):
        self.counts = Counter()
        self.latest = ''  # kind and text of the last one
        self._untold: list[str] = []

    def add(self, error: Exception) -> None:
        """Count an exception that was caught."""
        place, trace = '', error.__traceback__
        while trace is not None:
            code = trace.tb_frame.f_code
            place = f' in {Path(code.co_filename).name}, line {trace.tb_lineno}, {code.co_name}'
            trace = trace.tb_next
        kind = type(error).__name__ + place
        self.latest = f'{kind}: {error}'
        if not self.counts[kind]:
            self._untold.append(self.latest)
        self.counts[kind] += 1

    def take_new(self) -> list[str]:
        """Return a line for each kind that is new since the last call."""
        lines, self._untold = self._untold, []
        return lines


def braking_command(
    x: VehicleState,
    last: Command,
    line: np.ndarray | None,
    car: Car,
    limits: Limits,
    braking: Braking,
    step_s: float,
) -> Command:
    """Return the command with the stamp of `x` that brakes along `line`, points (n, 2) [m, map].

    It is finite, and within range, rates and friction, for every finite `last`. Without a line, or
    a finite state, the steering angle is held, and the brakes leave what a bend may need.
    """
    usable = limits.friction_use * min(car.mu_f, car.mu_r) * GRAVITY
    most_lateral = braking.lateral_use * usable
    known = all(math.isfinite(value) for value in x) and line is not None and len(line) > 1
    lateral, least = most_lateral, most_lateral
    if known:  # of the arc to a point of the line ahead (pure pursuit)
        preview = max(braking.preview_s * x.vx, braking.least_preview_m)
        ahead, aside = _point_ahead(x, line, preview)
        square, speed = ahead**2 + aside**2, math.hypot(x.vx, x.vy)
        lateral = 2 * speed * (x.vx * aside - x.vy * ahead) / square if square else 0.0
        lateral = min(max(lateral, -most_lateral), most_lateral)
        least = max(abs(lateral), min(abs(x.vx * x.r), most_lateral))
    before, force_step = last.Fxf + last.Fxr, limits.force_rate_nps * step_s
    force = min(max(-car.m * math.sqrt(usable**2 - least**2), -limits.brake_n), 0.0)
    force = min(max(force, before - force_step), before + force_step)
    if force < 0:  # shared as the axle loads are while braking
        front = (car.l_r - car.h * force / (car.m * GRAVITY)) / (car.l_f + car.l_r)
    else:
        front = last.Fxf / before if before > 0 else 0.0
    delta = last.delta
    if known:
        delta = _steering_angle(x, lateral, front * min(force, 0.0), force, car)
    steer_step = limits.steer_rate_radps * step_s
    delta = min(max(delta, -limits.steer_rad), limits.steer_rad)
    delta = min(max(delta, last.delta - steer_step), last.delta + steer_step)
    return Command(
        stamp_ns=x.stamp_ns,
        delta=float(delta),
        d_delta=float((delta - last.delta) / step_s),
        Fxf=float(front * force),
        Fxr=float((1 - front) * force),
    )


def _point_ahead(x, line, distance):
    """Return the point `distance` along the line after its point nearest to the car, from there.

    The line continues straight past its end.
    """
    chords = np.diff(line, axis=0)
    lengths = np.hypot(*chords.T)
    starts, chords, lengths = line[:-1][lengths > 0], chords[lengths > 0], lengths[lengths > 0]
    if not len(lengths):
        return distance, 0.0
    along = np.sum((np.array((x.X, x.Y)) - starts) * chords, axis=1) / lengths
    along = np.minimum(np.maximum(along, 0.0), lengths)
    feet = starts + (along / lengths)[:, None] * chords - (x.X, x.Y)
    nearest = int(np.argmin(np.sum(feet**2, axis=1)))
    before = np.concatenate(([0.0], np.cumsum(lengths)))
    s = before[nearest] + along[nearest] + distance
    k = min(int(np.searchsorted(before, s, side='right')), len(lengths)) - 1
    dX, dY = starts[k] + (s - before[k]) / lengths[k] * chords[k] - (x.X, x.Y)
    cos_psi, sin_psi = math.cos(x.psi), math.sin(x.psi)
    return cos_psi * dX + sin_psi * dY, cos_psi * dY - sin_psi * dX


def _steering_angle(x, lateral, front_force, force, car) -> float:
    """Return the angle at which the front axle gives its share of `lateral` (inverse Fiala)."""
    wheelbase = car.l_f + car.l_r
    Fz = (car.m * GRAVITY * car.l_r - car.h * force) / wheelbase
    Fy = car.m * abs(lateral) * car.l_r / wheelbase
    capacity = math.sqrt(max((car.mu_f * Fz) ** 2 - front_force**2, 0.0))
    use = min(Fy / capacity, 1.0) if capacity else 1.0
    slip = math.atan(3 * capacity * (1 - (1 - use) ** (1 / 3)) / car.C_f)
    slip += car.compliance * use * capacity
    if x.vx < SLOW_MPS:  # kinematic: the arc itself
        return math.atan(wheelbase * lateral / max(x.vx**2 + x.vy**2, SLOW_MPS**2))
    return math.atan((x.vy + car.l_f * x.r) / x.vx) + math.copysign(slip, lateral)
