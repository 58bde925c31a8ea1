"""Swing up the pole of a cart with limits of track and force.

    python stage_solver/examples/cart_pole.py

The cart has a mass of 1 kg, the pole 0.3 kg and a length of 0.5 m. The equations are those of a
frictionless cart-pole; the numbers are those of M. Kelly, "An Introduction to Trajectory
Optimization", SIAM Review 59 (2017), section 6.
"""

import casadi as ca
import numpy as np

from stage_solver import SolverOptions, StageProblem, make_solver, no_bounds, rk2, zero_plan

HORIZON, STEP_S, SUBSTEPS = 50, 0.04, 4  # two seconds
CART_KG, POLE_KG, LENGTH_M, GRAVITY = 1.0, 0.3, 0.5, 9.81
TRACK_M, FORCE_N = 2.0, 20.0
GOAL_M = 1.0  # position of the cart at the end


def rates(x, u, p):
    """Return the derivative of (position, angle, speed, angular speed); angle 0 hangs."""
    sine, cosine = ca.sin(x[1]), ca.cos(x[1])
    effective = CART_KG + POLE_KG * sine**2
    force = u[0]
    cart = force + POLE_KG * sine * (LENGTH_M * x[3] ** 2 + GRAVITY * cosine)
    pole = (CART_KG + POLE_KG) * GRAVITY * sine
    pole += cosine * (force + POLE_KG * LENGTH_M * x[3] ** 2 * sine)
    return ca.vertcat(x[2], x[3], cart / effective, -pole / (LENGTH_M * effective))


def make_problem():
    """Return the swing-up problem: minimise the integral of the squared force."""
    x, u, p = ca.SX.sym('x', 4), ca.SX.sym('u', 1), ca.SX.sym('p', 0)
    step = rk2(rates, STEP_S / SUBSTEPS)
    x_next = x
    for _ in range(SUBSTEPS):
        x_next = step(x_next, u, p)
    return StageProblem(
        name='cart_pole',
        states=('position', 'angle', 'speed', 'angular_speed'),
        inputs=('force',),
        parameters=(),
        horizon=HORIZON,
        dynamics=ca.Function('F', [x, u, p], [x_next]),
        stage_cost=ca.Function('l', [x, u, p], [STEP_S * u[0] ** 2]),
        terminal_constraints=ca.Function('h', [x, p], [x - ca.DM([GOAL_M, np.pi, 0, 0])]),
        scale_x=(1.0, 1.0, 3.0, 10.0),
        scale_u=(10.0,),
    )


def make_arguments(problem):
    """Return the arguments of a solve; the guess is a straight line to the goal."""
    bounds = no_bounds(problem)
    bounds.x_low[:, 0], bounds.x_high[:, 0] = -TRACK_M, TRACK_M
    bounds.u_low[:], bounds.u_high[:] = -FORCE_N, FORCE_N
    bounds.h_low[:] = bounds.h_high[:] = 0.0
    share = np.linspace(0.0, 1.0, HORIZON + 1)
    guess = zero_plan(problem)
    guess.X[:, 0], guess.X[:, 1] = GOAL_M * share, np.pi * share
    return np.zeros(4), np.zeros((HORIZON + 1, 0)), bounds, guess


def main():
    """Solve the problem and print the result."""
    problem = make_problem()
    solver = make_solver(problem, SolverOptions(max_iterations=300))
    solution = solver.solve(*make_arguments(problem))
    X, U = solution.plan.X, solution.plan.U
    time_ms = 1e3 * solution.solve_s
    print(f'{solution.status} after {solution.iterations} iterations, {time_ms:.1f} ms')
    print(f'cost {solution.cost:.2f} N^2 s, largest force {np.abs(U).max():.1f} N')
    print(f'the pole ends at {np.degrees(X[-1, 1]):.2f} deg, the cart at {X[-1, 0]:.3f} m')


if __name__ == '__main__':
    main()
