"""The state when a command takes hold, not when it was asked for: compensates computing time."""

from collections.abc import Callable

import casadi as ca

from mpcc_controller import shooting, single_track
from mpcc_controller.single_track import Car, Input, State
from mpcc_controller.target import SetPoints
from msgs_yaml import stamp
from msgs_yaml.types import VehicleState


def make(car: Car, lead_s: float) -> Callable[[VehicleState, SetPoints], VehicleState]:
    """Return a function that moves a state on by `lead_s` [s] while the set-points are held.

    One midpoint step of the prediction model; a lead of 0 returns the state itself.
    """
    x, u = ca.SX.sym('x', len(State._fields)), ca.SX.sym('u', len(Input._fields))
    rates = single_track.derivative(State(*ca.vertsplit(x)), Input(*ca.vertsplit(u)), car)
    f = ca.Function('rates', [x, u], [ca.vertcat(*rates)])
    step = shooting.rk2(lambda x, u, p: f(x, u), lead_s)
    moved = ca.Function('moved', [x, u], [step(x, u, None)])

    def ahead(measured: VehicleState, now: SetPoints) -> VehicleState:
        if not lead_s:
            return measured
        held = Input(0.0, 0.0, single_track.ideal_split(now.Fx, car), 0.0)
        start = State(*measured[1:], theta=0.0, delta=now.delta, Fx=now.Fx)
        end = State(*map(float, moved(start, held).full().ravel()))
        return VehicleState(
            stamp.later(measured.stamp_ns, lead_s), end.X, end.Y, end.psi, end.vx, end.vy, end.r
        )

    return ahead
