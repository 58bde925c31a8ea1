"""The state when a command takes hold, not when it was asked for: compensates the delay."""

import math

import casadi as ca
import numpy as np

from mpcc_controller.driving import commanded
from mpcc_controller.driving.commanded import Ramp
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, Input, State
from msgs_yaml.types import VehicleState
from stage_solver.stage_problem import rk2

LONGEST_STEP_S = 0.01  # of the integration


class Ahead:
    """Moves states on with the prediction model."""

    def __init__(self, car: Car):
        x, u = ca.SX.sym('x', len(State._fields)), ca.SX.sym('u', len(Input._fields))
        h = ca.SX.sym('h')
        rates = single_track.derivative(State(*ca.vertsplit(x)), Input(*ca.vertsplit(u)), car)
        f = ca.Function('rates', [x, u], [ca.vertcat(*rates)])
        step = rk2(lambda x, u, p: f(x, u), h)
        self._step = ca.Function('step', [x, u, h], [step(x, u, None)])

    def __call__(self, measured: VehicleState, told: Ramp, stamp_ns: int) -> VehicleState:
        """Return the state at `stamp_ns`, the measured one itself when that is its stamp.

        Midpoint steps of the prediction model under the set-points that the actuators have been
        told; as in the model, the actuators are where they are told to be.
        """
        if stamp_ns == measured.stamp_ns:
            return measured
        motion = np.array(measured[1:])
        for piece in commanded.pieces(told, measured.stamp_ns, stamp_ns):
            motion = self._over(piece, motion, told.lambda_b)
        return VehicleState(stamp_ns, *map(float, motion))

    def _over(self, piece, motion, lambda_b):
        rates = [(b - a) / piece.seconds for a, b in zip(piece.begin, piece.end)]
        u = Input(*rates, lambda_b, slack=0.0)
        x = np.array(State(*motion, theta=0.0, delta=piece.begin.delta, Fx=piece.begin.Fx))
        steps = math.ceil(piece.seconds / LONGEST_STEP_S)
        for _ in range(steps):
            x = self._step(x, u, piece.seconds / steps).full().ravel()
        return x[: len(motion)]
