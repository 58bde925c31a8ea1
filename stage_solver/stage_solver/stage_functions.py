"""One stage's functions and exact derivatives, in solver units, from which the NLP is assembled.

With w = [x; u] in solver units, the equality of stage k is x_{k+1} - F(w_k, p_k) = 0 and its
inequality is g(w_k, p_k); c = [-F; g] is the part of both that depends on w_k. The Lagrangian of a
stage is the sum of all terms that depend on w_k:

    L = lam_f l(w, p) + lam_c' c(w, p) + lam_before' x

with lam_before the multipliers of the equality before it, in which x_k appears as itself.
"""

from typing import NamedTuple

import casadi as ca

from stage_solver.stage_problem import StageProblem


class StageFunctions(NamedTuple):
    """Functions of (w, p, ...) of one stage; nonzeros are dense columns, in column-major order."""

    cost: ca.Function  # -> l
    gradient: ca.Function  # -> dl/dw
    constraints: ca.Function  # -> c
    jacobian: ca.Function  # -> c, nonzeros of `jacobian_pattern`
    hessian: ca.Function  # (w, p, lam_f, lam_c, lam_before) -> dL/dw, nonzeros of `hessian_pattern`
    lagrangian: ca.Function  # same arguments -> l, c, dL/dw
    jacobian_pattern: ca.Sparsity  # of [I; 0; dc/dw]: the block column of the NLP's Jacobian
    hessian_pattern: ca.Sparsity  # of d2L/dw2, both triangles


def make_stage(problem: StageProblem) -> StageFunctions:
    """Return the functions of stages 0..N-1 of a problem."""
    w, p = ca.SX.sym('w', problem.nx + problem.nu), ca.SX.sym('p', problem.np)
    x_next, cost, g = evaluate_stage(problem, w[: problem.nx], w[problem.nx :], p)
    return _differentiate('stage', problem, w, p, cost, ca.vertcat(-x_next, g))


def make_last_stage(problem: StageProblem) -> StageFunctions:
    """Return the functions of stage N, where w is the state alone and c is h."""
    w, p = ca.SX.sym('w', problem.nx), ca.SX.sym('p', problem.np)
    return _differentiate('last', problem, w, p, *evaluate_last_stage(problem, w, p))


def evaluate_stage(problem: StageProblem, x: ca.SX, u: ca.SX, p: ca.SX) -> tuple[ca.SX, ...]:
    """Return next state, cost and g of a stage; states and inputs are in solver units."""
    scale_x = ca.DM(problem.scale_x)
    arguments = x * scale_x, u * ca.DM(problem.scale_u), p
    x_next = problem.dynamics(*arguments) / scale_x
    return x_next, problem.stage_cost(*arguments), problem.constraints(*arguments)


def evaluate_last_stage(problem: StageProblem, x: ca.SX, p: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return cost and h of stage N; the state is in solver units."""
    x = x * ca.DM(problem.scale_x)
    return problem.terminal_cost(x, p), problem.terminal_constraints(x, p)


def _differentiate(name, problem, w, p, cost, c):
    cost, c = ca.densify(cost), ca.densify(c)
    lam_f = ca.SX.sym('lam_f')
    lam_c = ca.SX.sym('lam_c', c.numel())
    lam_before = ca.SX.sym('lam_before', problem.nx)
    lagrangian = lam_f * cost + ca.dot(lam_c, c) + ca.dot(lam_before, w[: problem.nx])
    gradient = ca.densify(ca.gradient(lagrangian, w))
    hessian = ca.jacobian(gradient, w, {'symmetric': True})
    from_before = ca.horzcat(ca.SX.eye(problem.nx), ca.SX(problem.nx, w.numel() - problem.nx))
    column = ca.vertcat(from_before, ca.SX(problem.ng, w.numel()), ca.jacobian(c, w))
    arguments = [w, p, lam_f, lam_c, lam_before]
    return StageFunctions(
        cost=ca.Function(f'{name}_f', [w, p], [cost]),
        gradient=ca.Function(f'{name}_grad', [w, p], [ca.densify(ca.gradient(cost, w))]),
        constraints=ca.Function(f'{name}_g', [w, p], [c]),
        jacobian=ca.Function(f'{name}_jac', [w, p], [c, _finite(column.nz[:])]),
        hessian=ca.Function(f'{name}_hess', arguments, [gradient, _finite(hessian.nz[:])]),
        lagrangian=ca.Function(f'{name}_lagr', arguments, [cost, c, gradient]),
        jacobian_pattern=column.sparsity(),
        hessian_pattern=hessian.sparsity(),
    )


def _finite(nonzeros):
    """Return the derivatives, 0 in place of those that are not finite.

    fatrop raises its inertia correction until the factorisation succeeds; with a NaN it would not
    return. A derivative is infinite at finite values where the argument of a root is zero; a zero
    there costs iterations only.
    """
    values = [ca.if_else(ca.fabs(v) < ca.inf, v, 0) for v in ca.vertsplit(nonzeros)]
    return ca.vertcat(ca.SX(0, 1), *values)
