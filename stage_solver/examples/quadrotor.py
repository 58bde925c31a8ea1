"""Fly a planar quadrotor past discs with minimum thrust.

    python stage_solver/examples/quadrotor.py

States are position, pitch and their rates, inputs the thrusts of the two rotors. The discs
are parameters of each stage, so they may move or change without another compilation.
"""

import casadi as ca
import numpy as np

from stage_solver import SolverOptions, StageProblem, make_solver, no_bounds, rk2, zero_plan

HORIZON, STEP_S = 60, 0.05
MASS_KG, INERTIA_KGM2, ARM_M, GRAVITY = 0.5, 0.01, 0.2, 9.81
HOVER_N, MAX_THRUST_N = MASS_KG * GRAVITY / 2, 6.0
GOAL = (6.0, 0.0)
DISCS = ((2.0, -0.2, 0.8), (4.0, 0.4, 0.7))  # x, y, radius with clearance [m]


def rates(x, u, p):
    """Return the derivative of (x, y, pitch, vx, vy, pitch rate)."""
    thrust = u[0] + u[1]
    return ca.vertcat(
        x[3],
        x[4],
        x[5],
        -thrust / MASS_KG * ca.sin(x[2]),
        thrust / MASS_KG * ca.cos(x[2]) - GRAVITY,
        ARM_M * (u[1] - u[0]) / INERTIA_KGM2,
    )


def make_problem():
    """Return the flight to GOAL; a constraint keeps the centre outside of each disc."""
    x, u, p = ca.SX.sym('x', 6), ca.SX.sym('u', 2), ca.SX.sym('p', 3 * len(DISCS))
    discs = [p[3 * k : 3 * k + 3] for k in range(len(DISCS))]
    gaps = [(x[0] - d[0]) ** 2 + (x[1] - d[1]) ** 2 - d[2] ** 2 for d in discs]
    effort = (u[0] - HOVER_N) ** 2 + (u[1] - HOVER_N) ** 2 + 0.1 * x[2] ** 2 + 0.01 * x[5] ** 2
    goal = ca.DM([*GOAL, 0, 0, 0, 0])
    return StageProblem(
        name='quadrotor',
        states=('x', 'y', 'pitch', 'vx', 'vy', 'pitch_rate'),
        inputs=('left', 'right'),
        parameters=tuple(f'{name}_{k}' for k in range(len(DISCS)) for name in ('x', 'y', 'r')),
        horizon=HORIZON,
        dynamics=ca.Function('F', [x, u, p], [rk2(rates, STEP_S)(x, u, p)]),
        stage_cost=ca.Function('l', [x, u, p], [STEP_S * effort]),
        constraints=ca.Function('g', [x, u, p], [ca.vertcat(*gaps)]),
        terminal_constraints=ca.Function('h', [x, p], [x - goal]),
        scale_x=(2.0, 1.0, 0.5, 2.0, 2.0, 2.0),
        scale_u=(2.0, 2.0),
    )


def make_arguments(problem):
    """Return the arguments of a solve; the guess passes one disc above and one below."""
    bounds = no_bounds(problem)
    bounds.u_low[:], bounds.u_high[:] = 0.0, MAX_THRUST_N
    bounds.g_low[:] = 0.0
    bounds.h_low[:] = bounds.h_high[:] = 0.0
    share = np.linspace(0.0, 1.0, HORIZON + 1)
    guess = zero_plan(problem)
    guess.X[:, 0] = GOAL[0] * share
    guess.X[:, 1] = 0.9 * np.sin(2 * np.pi * share)  # the sides on which to pass the discs
    guess.U[:] = HOVER_N
    P = np.tile(np.ravel(DISCS), (HORIZON + 1, 1))
    return np.zeros(6), P, bounds, guess


def clearances(X):
    """Return the smallest distance [m] of a flight to each disc."""
    return [np.hypot(X[:, 0] - x, X[:, 1] - y).min() - r for x, y, r in DISCS]


def main():
    """Solve the problem and print the result."""
    problem = make_problem()
    solver = make_solver(problem, SolverOptions(max_iterations=300))
    solution = solver.solve(*make_arguments(problem))
    time_ms = 1e3 * solution.solve_s
    print(f'{solution.status} after {solution.iterations} iterations, {time_ms:.1f} ms')
    gaps = ', '.join(f'{gap:.4f}' for gap in clearances(solution.plan.X))
    print(f'smallest clearance to each disc: {gaps} m')
    print(f'largest thrust {solution.plan.U.max():.2f} N of {MAX_THRUST_N:g} N')


if __name__ == '__main__':
    main()
