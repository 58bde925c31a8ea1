"""Who drives in a search: an MPCC that foresees, or feedback that tracks a manoeuvre.

The tracker steers by look-ahead error and path curvature (Kapania and Gerdes, "Design of a
feedback-feedforward steering controller", 2015), never beyond the slip angle at which the front
tyres peak, and brakes with what the lateral acceleration leaves of the friction circle.
"""

import dataclasses
from typing import NamedTuple

import numpy as np

from experiments.survivable.emergency import TICK_S, Emergency
from experiments.survivable.road_coordinates import Path, reference_of
from experiments.survivable.sides import Approach
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.records import TickInputs
from mpcc_controller.parameters import ControllerParams
from msgs_yaml import conversions
from msgs_yaml.types import Command, Obstacles
from node_runtime import parameters
from vehicle_plant.simulator import Simulator

DELAY_S = 0.08  # from a state to the middle of the force that answers it
WINDOW = 60  # samples of the path that are searched around the last foot


class Foresight:
    """An MPCC that is given the road's friction, the path of an approach and all obstacles."""

    def __init__(self, emergency: Emergency, params: ControllerParams, approach: Approach):
        """Start at the emergency's instant, with the set-points where the actuators are."""
        setup = emergency.setup
        # it knows the friction, and measures without errors
        groups = {n: getattr(params, n) for n in ('friction_estimate', 'measurement_errors')}
        left_out = {n: type(g)(**dict.fromkeys(parameters.flatten(g))) for n, g in groups.items()}
        model = dataclasses.replace(params.model, friction=setup.friction)
        params = dataclasses.replace(params, model=model, **left_out)
        self._controller = Controller(params, setup.vehicle)
        self._controller.reset(emergency.car.actuators)
        reference = reference_of(approach.path, approach.speed, emergency.start_ns)
        rejected = self._controller.set_reference(conversions.reference_as_received(reference))
        if rejected:
            raise ValueError(f'the path of an approach is unusable: {rejected}')
        self._controller.set_edges(setup.scn.edges)

    def __call__(self, car: Simulator, obstacles: Obstacles) -> Command:
        """Return the command of a tick."""
        self._controller.set_obstacles(obstacles)
        state = conversions.odometry_as_received(car.state)
        return self._controller.step(TickInputs(state, actuators=car.actuators)).command


class Manoeuvre(NamedTuple):
    """A path and a longitudinal acceleration over time, and how sharply the path is tracked."""

    path: Path
    ax: np.ndarray  # m/s^2, one per tick; the last one stays
    lookahead_s: float = 0.5
    gain: float = 0.06  # rad per m of look-ahead error
    slip: float = 0.14  # rad, of the front tyres at most


class Tracker:
    """Tracks a manoeuvre from the emergency's instant on."""

    def __init__(self, emergency: Emergency, manoeuvre: Manoeuvre):
        """Start with the set-points where the actuators are."""
        self._m = manoeuvre
        self._car = car = emergency.setup.plant.car
        self._grip = emergency.setup.friction * car.body.gravity_mps2
        self._tick = 0
        self._foot: int | None = None
        now = emergency.car.actuators
        self._delta, self._Fxf, self._Fxr = now.delta, now.Fxf, now.Fxr

    def __call__(self, car: Simulator, obstacles: Obstacles) -> Command:
        """Return the command of a tick; the obstacles are in the manoeuvre already."""
        x = car.state
        ax = float(self._m.ax[min(self._tick, len(self._m.ax) - 1)])
        self._tick += 1
        delta = self._steer(x)
        rate = self._car.steering.rate_radps * TICK_S
        delta = float(np.clip(delta, self._delta - rate, self._delta + rate))
        self._delta = float(np.clip(delta, *np.array([-1, 1]) * self._car.steering.limit_rad))
        self._Fxf, self._Fxr = self._forces(x, ax)
        return Command(x.stamp_ns, self._delta, 0.0, self._Fxf, self._Fxr)

    def _steer(self, x):
        m, body = self._m, self._car.body
        psi = x.psi + x.r * DELAY_S
        c, s = np.cos((x.psi + psi) / 2), np.sin((x.psi + psi) / 2)
        X, Y = x.X + (x.vx * c - x.vy * s) * DELAY_S, x.Y + (x.vx * s + x.vy * c) * DELAY_S
        i = self._find_foot(X, Y)
        path = m.path
        heading = path.psi[i]
        dX, dY = X - path.X[i], Y - path.Y[i]
        e = dY * np.cos(heading) - dX * np.sin(heading)
        ahead = max(x.vx, 3.0) * m.lookahead_s
        error = e + ahead * np.sin(psi - heading)
        j = min(i + round(0.25 * ahead / 0.5), len(path.kappa) - 1)
        wheelbase = body.cog_to_front_m + body.cog_to_rear_m
        understeer = 0.0008  # rad per m/s^2
        feedforward = path.kappa[j] * (wheelbase + understeer * x.vx**2)
        axle = np.arctan2(x.vy + body.cog_to_front_m * x.r, max(x.vx, 1.0))
        wish = feedforward - m.gain * error
        return float(np.clip(wish, axle - m.slip, axle + m.slip))

    def _forces(self, x, ax):
        lateral = min(abs(x.vx * x.r) / self._grip, 0.98)
        most = self._grip * np.sqrt(1 - lateral**2)
        F = self._car.body.mass_kg * float(np.clip(ax, -most, most))
        if x.vx < 0.5:
            F = min(F, 0.0)
        force = self._car.force
        if F > 0:  # the engine drives where it can
            return min(F, force.front.drive_n), min(F, force.rear.drive_n)
        return max(0.66 * F, -force.front.brake_n), max(0.34 * F, -force.rear.brake_n)

    def _find_foot(self, X, Y):
        path = self._m.path
        window = slice(0, len(path.X))
        if self._foot is not None:
            window = slice(max(0, self._foot - 5), self._foot + WINDOW)
        square = (path.X[window] - X) ** 2 + (path.Y[window] - Y) ** 2
        self._foot = window.start + int(np.argmin(square))
        return self._foot
