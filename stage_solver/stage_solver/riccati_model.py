"""The functions of one stage that the Riccati solver evaluates, with exact derivatives.

With w = [u; x] in solver units, the multipliers `lam` of the dynamics and `y` of the constraints,

    L = l(w, p) + lam' F(w, p) + y' g(w, p).

`sigma` and `push` hold the curvature and the slope of the barrier in w and in the slacks of g
(docs/solver.md, eq. 5): the matrix H and the slope q of the quadratic programme already hold them.
"""

from typing import NamedTuple

import casadi as ca

from stage_solver.stage_problem import StageProblem

ONCE_INPUTS = {'p'}  # what does not change during a solve


class Model(NamedTuple):
    """The functions of one kind of stage."""

    values: ca.Function  # (w, p) -> F, cost, g
    quadratic: ca.Function  # (w, p, lam, y, sigma, push) -> q, H (upper triangle), JF, Jg
    slope: ca.Function  # (w, p, lam, y) -> dL/dw


def stage(problem: StageProblem) -> Model:
    """Return the functions of the stages before the last."""
    w = ca.SX.sym('w', problem.nu + problem.nx)
    p = ca.SX.sym('p', problem.np)
    u = w[: problem.nu] * ca.DM(problem.scale_u)
    x = w[problem.nu :] * ca.DM(problem.scale_x)
    F = problem.dynamics(x, u, p) / ca.DM(problem.scale_x)
    return _model('stage', w, p, F, problem.stage_cost(x, u, p), problem.constraints(x, u, p))


def last(problem: StageProblem) -> Model:
    """Return the functions of the last stage, where w is the state and nothing follows."""
    w = ca.SX.sym('w', problem.nx)
    p = ca.SX.sym('p', problem.np)
    x = w * ca.DM(problem.scale_x)
    cost, g = problem.terminal_cost(x, p), problem.terminal_constraints(x, p)
    return _model('last', w, p, ca.SX(0, 1), cost, g)


def _model(name, w, p, F, cost, g):
    F, cost, g = (ca.densify(ca.vec(v)) for v in (F, cost, g))
    n, n_g = w.numel(), g.numel()
    lam, y = ca.SX.sym('lam', F.numel()), ca.SX.sym('y', n_g)
    sigma, push = ca.SX.sym('sigma', n + n_g), ca.SX.sym('push', n + n_g)
    slope = ca.gradient(cost + ca.dot(lam, F) + ca.dot(y, g), w)
    JF, Jg = ca.jacobian(F, w), ca.jacobian(g, w)
    H = ca.jacobian(slope, w, {'symmetric': True})
    H += ca.diag(sigma[:n]) + Jg.T @ ca.diag(sigma[n:]) @ Jg
    q = ca.gradient(cost, w) + push[:n] + Jg.T @ push[n:]
    return Model(
        values=ca.Function(f'{name}_values', [w, p], [F, cost, g], ['w', 'p'], ['F', 'cost', 'g']),
        quadratic=ca.Function(
            f'{name}_quadratic',
            [w, p, lam, y, sigma, push],
            [ca.densify(q), ca.triu(H), JF, Jg],
            ['w', 'p', 'lam', 'y', 'sigma', 'push'],
            ['q', 'H', 'JF', 'Jg'],
        ),
        slope=ca.Function(
            f'{name}_slope',
            [w, p, lam, y],
            [ca.densify(slope)],
            ['w', 'p', 'lam', 'y'],
            ['slope'],
        ),
    )
