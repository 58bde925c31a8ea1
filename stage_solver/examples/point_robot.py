"""Drive a point robot along a given path in the least time: the stages are places, not times.

    python stage_solver/examples/point_robot.py

The state is the square of the speed, the input the acceleration along the path; both are exact over
a step of constant acceleration (Verscheure et al., "Time-optimal path tracking for robots", IEEE
Transactions on Automatic Control 54, 2009). The whole acceleration is bounded by a circle; the
curvature of the path is a parameter of each stage.
"""

import casadi as ca
import numpy as np

from stage_solver import Plan, SolverOptions, StageProblem, make_solver, no_bounds

HORIZON, STEP_M = 80, 0.5
LIMIT_MPS2 = 4.0
SLOW_MPS = 0.5  # at both ends


def problem():
    """Return the problem: the sum of the times of all steps is least."""
    x, u, p = ca.SX.sym('x', 1), ca.SX.sym('u', 1), ca.SX.sym('p', 1)
    following = x + 2 * u * STEP_M
    time_s = 2 * STEP_M / (ca.sqrt(x) + ca.sqrt(following))
    return StageProblem(
        name='point_robot',
        states=('speed_squared',),
        inputs=('acceleration',),
        parameters=('curvature',),
        horizon=HORIZON,
        dynamics=ca.Function('F', [x, u, p], [following]),
        stage_cost=ca.Function('l', [x, u, p], [time_s]),
        terminal_cost=ca.Function('m', [x, p], [ca.SX(0)]),
        constraints=ca.Function('g', [x, u, p], [u**2 + (p * x) ** 2]),
        terminal_constraints=ca.Function('h', [x, p], [x]),
        scale_x=(20.0,),
        scale_u=(2.0,),
    )


def numbers(path, curvature):
    """Return state, stage parameters, bounds and a guess for a curvature (N + 1,) [1/m]."""
    bounds = no_bounds(path)
    bounds.x_low[:] = 0.9 * SLOW_MPS**2
    bounds.g_high[:] = LIMIT_MPS2**2
    bounds.h_low[:] = bounds.h_high[:] = SLOW_MPS**2
    slow = Plan(np.full((HORIZON + 1, 1), SLOW_MPS**2), np.zeros((HORIZON, 1)))
    return np.array([SLOW_MPS**2]), np.reshape(curvature, (-1, 1)), bounds, slow


def straight_s():
    """Return the least time of a straight path: full acceleration, then full braking."""
    fastest = np.sqrt(SLOW_MPS**2 + LIMIT_MPS2 * HORIZON * STEP_M)
    return 2.0 * (fastest - SLOW_MPS) / LIMIT_MPS2


def bend():
    """Return the curvature [1/m] of a path with a bend of 8 m radius in its middle."""
    return 0.125 * np.exp(-(((np.arange(HORIZON + 1) - HORIZON / 2) / 10.0) ** 4))


def main():
    """Solve both and say what came out."""
    path = problem()
    solver = make_solver(path, SolverOptions())  # compiled once, for any curvature
    for name, curvature in (('straight', np.zeros(HORIZON + 1)), ('bend', bend())):
        solution = solver.solve(*numbers(path, curvature))
        fastest = np.sqrt(solution.plan.X.max())
        print(f'{name}: {solution.status} after {solution.iterations} iterations, ', end='')
        print(f'{1e3 * solution.solve_s:.1f} ms; {solution.cost:.3f} s, up to {fastest:.1f} m/s')
    print(f'straight in closed form: {straight_s():.3f} s')


if __name__ == '__main__':
    main()
