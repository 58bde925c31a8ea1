"""Initial guesses of the plan: the last plan shifted by a tick, or the path itself. SI units."""

from collections.abc import Callable

import numpy as np

from mpcc_controller.driving.setpoints import SetpointTarget
from mpcc_controller.model.single_track import Car, Input, State, ideal_split
from mpcc_controller.path import arc, reference_path
from mpcc_controller.path.reference_path import ReferencePath
from stage_solver import stage_problem
from stage_solver.stage_problem import Plan


def guess_from_path(path: ReferencePath, x0: State, car: Car, horizon: int, dt: float) -> Plan:
    """Return a plan along the path at the present speed that closes the offset from it.

    The offset fades linearly over the horizon; the steering angle is that of the path's curvature
    without slip. It needs no previous plan: it starts the controller and follows failures.
    """
    t = dt * np.arange(horizon + 1)
    theta = x0.theta + x0.vx * t
    arcs, _ = reference_path.arcs_at(path, theta)
    start = arc.Pose(*(field[0] for field in arc.pose_at(arcs, theta)))
    offset = arc.contouring_error(start, x0.X, x0.Y) * (1 - t / t[-1])
    zeros = np.zeros_like(t)
    states = State(
        X=arcs.X - offset * np.sin(arcs.psi),
        Y=arcs.Y + offset * np.cos(arcs.psi),
        psi=arcs.psi,
        vx=zeros + x0.vx,
        vy=zeros,
        r=x0.vx * arcs.kappa,
        theta=theta,
        delta=(car.l_f + car.l_r) * arcs.kappa,
        Fx=zeros,
    )
    constant = Input(d_delta=0.0, d_Fx=0.0, lambda_b=ideal_split(0.0, car), slack=0.0)
    return start_at(Plan(np.column_stack(states), np.tile(constant, (horizon, 1))), x0)


def guess_from_law(
    law: Callable[[State], SetpointTarget],
    step: Callable,
    car: Car,
    x0: State,
    horizon: int,
    dt: float,
) -> Plan:
    """Return the plan that a control law drives in the prediction model (single shooting).

    `law` gives the set-points at the end of a tick from the state at its begin; `step` is that of
    `single_track.step`. The guess obeys the dynamics and the limits of the actuators, from any
    state: a car that slides is not near any plan along the path.
    """
    X, U, parameters = [np.array(x0, float)], [], np.array(car)
    for _ in range(horizon):
        x = State(*X[-1].tolist())
        target = law(x)
        rates = (target.delta - x.delta) / dt, (target.Fx - x.Fx) / dt
        u = Input(*rates, lambda_b=target.lambda_b, slack=0.0)
        U.append(np.array(u, float))
        X.append(step(X[-1], U[-1], parameters))
    return Plan(np.array(X), np.array(U))


def start_at(plan: Plan, x0: State) -> Plan:
    """Return the plan with `x0` as its first state and theta counted from that of x0.

    theta is projected on the path at every tick: the theta of the whole plan moves with it.
    """
    X = np.array(plan.X)
    theta = State._fields.index('theta')
    X[:, theta] += x0.theta - X[0, theta]
    X[0] = x0
    return plan._replace(X=X)


def shift_to(plan: Plan, step: Callable, car: Car, x0: State) -> Plan:
    """Return the plan one tick later, starting at the measured state `x0`.

    `step` is that of `single_track.step`: (x, u, car) -> the state one tick later.
    """
    return start_at(stage_problem.shift(plan, step, np.array(car)), x0)
