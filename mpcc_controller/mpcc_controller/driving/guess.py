"""First guesses of the plan: the last plan moved on, or the path itself. SI units."""

import casadi as ca
import numpy as np

from mpcc_controller.model.single_track import Car, Input, State, ideal_split
from mpcc_controller.path import arc, reference
from mpcc_controller.path.reference import Path
from stage_solver.stage_problem import Plan, shift


def from_path(path: Path, x0: State, car: Car, horizon: int, dt: float) -> Plan:
    """Return a drive along the path at the present speed, from beside it onto it.

    The offset from the path fades over the horizon; the steering angle is that of the path's
    curvature without slip. It needs no former plan: it starts the controller and follows failures.
    """
    t = dt * np.arange(horizon + 1)
    theta = x0.theta + x0.vx * t
    arcs, _ = reference.at(path, theta)
    here = arc.Pose(*(field[0] for field in arc.at(arcs, theta)))
    offset = -arc.contouring(here, x0.X, x0.Y) * (1 - t / t[-1])
    still = np.zeros_like(t)
    states = State(
        X=arcs.X - offset * np.sin(arcs.psi),
        Y=arcs.Y + offset * np.cos(arcs.psi),
        psi=arcs.psi,
        vx=still + x0.vx,
        vy=still,
        r=x0.vx * arcs.kappa,
        theta=theta,
        delta=(car.l_f + car.l_r) * arcs.kappa,
        Fx=still,
    )
    resting = Input(d_delta=0.0, d_Fx=0.0, lambda_b=ideal_split(0.0, car), slack=0.0)
    return start_at(Plan(np.column_stack(states), np.tile(resting, (horizon, 1))), x0)


def start_at(plan: Plan, x0: State) -> Plan:
    """Return the plan with the state `x0` in front and its theta counted from x0's.

    theta is projected on the path anew at every tick: the whole plan moves along with it.
    """
    X = np.array(plan.X)
    theta = State._fields.index('theta')
    X[:, theta] += x0.theta - X[0, theta]
    X[0] = x0
    return plan._replace(X=X)


def moved_on(plan: Plan, motion: ca.Function, numbers: tuple, x0: State) -> Plan:
    """Return the plan one tick later, starting at the measured state `x0`.

    `motion` moves (x, u, numbers) on by one step, as `single_track.step` does with those of a car.
    """
    return start_at(shift(plan, motion, np.array(numbers)), x0)
