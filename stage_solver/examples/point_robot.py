"""Drive a point robot along a given path in minimum time; the stages are points of the path.

    python stage_solver/examples/point_robot.py

The state is the square of the speed, the input the acceleration along the path; both are exact over
a step of constant acceleration (Verscheure et al., "Time-optimal path tracking for robots", IEEE
Transactions on Automatic Control 54, 2009). A circle bounds the acceleration vector; the curvature
of the path is a parameter of each stage.
"""

import casadi as ca
import numpy as np

from stage_solver import Plan, SolverOptions, StageProblem, make_solver, no_bounds

HORIZON, STEP_M = 80, 0.5
MAX_ACCELERATION_MPS2 = 4.0
END_SPEED_MPS = 0.5  # at both ends


def make_problem():
    """Return the problem: minimise the sum of the times of all steps."""
    x, u, p = ca.SX.sym('x', 1), ca.SX.sym('u', 1), ca.SX.sym('p', 1)
    x_next = x + 2 * u * STEP_M
    time_s = 2 * STEP_M / (ca.sqrt(x) + ca.sqrt(x_next))
    return StageProblem(
        name='point_robot',
        states=('speed_squared',),
        inputs=('acceleration',),
        parameters=('curvature',),
        horizon=HORIZON,
        dynamics=ca.Function('F', [x, u, p], [x_next]),
        stage_cost=ca.Function('l', [x, u, p], [time_s]),
        constraints=ca.Function('g', [x, u, p], [u**2 + (p * x) ** 2]),
        terminal_constraints=ca.Function('h', [x, p], [x]),
        scale_x=(20.0,),
        scale_u=(2.0,),
    )


def make_arguments(problem, curvature):
    """Return the arguments of a solve for a curvature (N + 1,) [1/m]; the guess is slow."""
    bounds = no_bounds(problem)
    bounds.x_low[:] = 0.9 * END_SPEED_MPS**2
    bounds.g_high[:] = MAX_ACCELERATION_MPS2**2
    bounds.h_low[:] = bounds.h_high[:] = END_SPEED_MPS**2
    guess = Plan(np.full((HORIZON + 1, 1), END_SPEED_MPS**2), np.zeros((HORIZON, 1)))
    return np.array([END_SPEED_MPS**2]), np.reshape(curvature, (-1, 1)), bounds, guess


def straight_time_s():
    """Return the minimum time of a straight path: full acceleration, then full braking."""
    top_speed = np.sqrt(END_SPEED_MPS**2 + MAX_ACCELERATION_MPS2 * HORIZON * STEP_M)
    return 2.0 * (top_speed - END_SPEED_MPS) / MAX_ACCELERATION_MPS2


def bend_curvature():
    """Return the curvature [1/m] of a path with a bend of 8 m radius in its middle."""
    return 0.125 * np.exp(-(((np.arange(HORIZON + 1) - HORIZON / 2) / 10.0) ** 4))


def main():
    """Solve both paths and print the results."""
    problem = make_problem()
    solver = make_solver(problem, SolverOptions())  # compiled once, for any curvature
    for name, curvature in (('straight', np.zeros(HORIZON + 1)), ('bend', bend_curvature())):
        solution = solver.solve(*make_arguments(problem, curvature))
        top_speed = np.sqrt(solution.plan.X.max())
        print(f'{name}: {solution.status} after {solution.iterations} iterations, ', end='')
        print(f'{1e3 * solution.solve_s:.1f} ms; {solution.cost:.3f} s, up to {top_speed:.1f} m/s')
    print(f'straight in closed form: {straight_time_s():.3f} s')


if __name__ == '__main__':
    main()
