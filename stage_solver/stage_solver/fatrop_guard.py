"""Can fatrop's Riccati recursion factorise a problem with this Jacobian, with enough correction?

fatrop adds d I to the Hessian, with ever larger d, until every pivot of its recursion is positive.
It counts neither these attempts nor their time, so it must only get Jacobians for which some d is
enough. For large d the Hessian itself no longer matters, and the recursion is d times that of the
Hessian I, in which each inequality g counts as a penalty |g|^2:

    P_N = I + G_N' G_N,   M_k = I + G_k' G_k + [A B]' P_{k+1} [A B],   P_k = M_k / (its u, u block)

P_k, the Schur complement, is never below I. Rounding takes some c eps trace(M_k) away from M_k, and
no later stage makes a greater share of P out of it: as long as the shares sum up to less than 1,
all pivots are positive. c eps is below 1e-13 for some ten variables, which alone would allow 1e13.
The barrier weighs each inequality by its multiplier over its slack, which is unknown here: in a
restoration phase fatrop did not return at 1.8e10, and outside it at 5e15.
"""

import casadi as ca

from stage_solver.stage_functions import StageFunctions
from stage_solver.stage_problem import StageProblem

# of the sum of all trace(M_k); at most 1.5e5 in the golden bags and the loops of the benchmark
MAX_GROWTH = 1e8


def growth(
    problem: StageProblem, stage: StageFunctions, last: StageFunctions, J: ca.MX, j_last: ca.MX
) -> ca.MX:
    """Return the sum of all |trace(M_k)|; inf or NaN where it overflows.

    Without rounding no trace is negative. Beyond some 1e15 the recursion loses its own pivots to
    rounding, and negative traces must not cancel the large ones before.

    J holds the nonzeros of the stages' Jacobians, one column per stage, j_last those of the last.
    """
    step, end = _step(problem, stage), _end(problem, last)
    P, first_trace = end(j_last)
    backwards = J[:, list(reversed(range(problem.horizon)))]
    _, traces = step.mapaccum(problem.horizon)(P, backwards)
    return first_trace + ca.sum2(ca.fabs(traces))


def _end(problem, last):
    nonzeros = ca.SX.sym('j', last.jacobian_pattern.nnz())
    G = ca.SX(last.jacobian_pattern, nonzeros)[problem.nx + problem.ng :, :]
    P = ca.SX.eye(problem.nx) + G.T @ G
    return ca.Function('riccati_end', [nonzeros], [ca.densify(P), ca.trace(P)])


def _step(problem, stage):
    nx, nu, nc = problem.nx, problem.nu, problem.nx + problem.ng
    P = ca.SX.sym('P', nx, nx)
    nonzeros = ca.SX.sym('j', stage.jacobian_pattern.nnz())
    J = ca.SX(stage.jacobian_pattern, nonzeros)[nc:, :]
    dynamics, G = J[:nx, :], J[nx:, :]  # -[A B]: its sign cancels
    M = ca.SX.eye(nx + nu) + G.T @ G + dynamics.T @ P @ dynamics
    trace = ca.trace(M)
    for _ in range(nu):  # eliminates the last variable
        column = M[:-1, -1]
        M = M[:-1, :-1] - column @ column.T / M[-1, -1]
    return ca.Function('riccati_step', [P, nonzeros], [ca.densify(M), trace])
