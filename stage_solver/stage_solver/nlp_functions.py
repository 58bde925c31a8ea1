"""The functions of the whole NLP, assembled from N calls of one stage's functions.

Variables v = [x_0; u_0; x_1; u_1; ...; x_N], constraints [x_1 - F_0; g_0; x_2 - F_1; ...; h], the
order that fatrop expects (Vanroye et al. 2023, https://arxiv.org/abs/2303.16746); parameters are
the stages' parameters in the order of the stages. The stage functions stay calls (a loop in the
generated C): the expanded graph of 50 stages is ten times the code, takes minutes to compile and
runs slower.
"""

from functools import lru_cache
from typing import NamedTuple

import casadi as ca

from stage_solver import fatrop_guard, stage_functions
from stage_solver.stage_problem import MAX_CACHED_PROBLEMS, StageProblem

MAX_HESSIAN = 1e100  # sum of all magnitudes; far from both any problem and overflow


class _Symbols(NamedTuple):
    v: ca.MX
    p: ca.MX
    lam_f: ca.MX
    lam_g: ca.MX


class _Stages(NamedTuple):
    W: ca.MX  # (nx + nu, N)
    w_last: ca.MX  # (nx,)
    P: ca.MX  # (np, N)
    p_last: ca.MX  # (np,)


@lru_cache(MAX_CACHED_PROBLEMS)
def build(problem: StageProblem, solver: str) -> dict[str, ca.Function]:
    """Return the functions that CasADi's nlpsol evaluates, under its names for them.

    solver is 'fatrop' or 'ipopt': they take the gradient and the Hessian in different forms.
    `nlp` is the problem itself, `nlp_grad` is (v, p, lam_f, lam_g) -> f, g, gradient of the
    Lagrangian; its fourth output, the gradient with respect to p, is empty because nlpsol does not
    use it. fatrop's Hessian is 0 where the cost has no weight (`_guard_hessian`), and its Jacobian
    is replaced where its recursion would fail (`fatrop_guard`). The result is cached: do not
    change it.
    """
    stage, last = stage_functions.make_stage(problem), stage_functions.make_last_stage(problem)
    symbols = _symbols(problem)
    stages = _split(problem, symbols)
    f, g = _values(problem, stage, last, stages)
    gradient = ca.vertcat(
        ca.vec(stage.gradient.map(problem.horizon)(stages.W, stages.P)),
        last.gradient(stages.w_last, stages.p_last),
    )
    jacobian_g, jacobian = _jacobian(problem, stage, last, stages, guarded=solver == 'fatrop')
    multipliers = _split_multipliers(problem, symbols)
    gradient_l, hessian = _hessian(problem, stage, last, stages, multipliers)
    if solver == 'fatrop':
        hessian = _guard_hessian(symbols, hessian)
    outputs = {
        'nlp': {'f': f, 'g': g},
        'nlp_f': {'f': f},
        'nlp_g': {'g': g},
        'nlp_grad_f': {'grad_f_x': gradient},
        'nlp_jac_g': {'g': jacobian_g, 'jac_g_x': jacobian},
        'nlp_hess_l': {'grad_gamma_x': gradient_l, 'hess_gamma_x_x': hessian},
        'nlp_grad': _lagrangian(problem, stage, last, stages, multipliers),
    }
    if solver == 'ipopt':
        outputs['nlp_grad_f'] = {'f': f, 'grad_f_x': gradient}
        outputs['nlp_hess_l'] = {'triu_hess_gamma_x_x': ca.triu(hessian)}
    plan_inputs = {'x': symbols.v, 'p': symbols.p}
    lagrangian_inputs = plan_inputs | {'lam_f': symbols.lam_f, 'lam_g': symbols.lam_g}
    functions = {}
    for name, results in outputs.items():
        inputs = lagrangian_inputs if name in ('nlp_hess_l', 'nlp_grad') else plan_inputs
        arguments = [*inputs.values()], [*results.values()], [*inputs], [*results]
        functions[name] = ca.Function(name, *arguments)
    return functions


def _symbols(problem):
    N, nx = problem.horizon, problem.nx
    return _Symbols(
        v=ca.MX.sym('x', N * (nx + problem.nu) + nx),
        p=ca.MX.sym('p', (N + 1) * problem.np),
        lam_f=ca.MX.sym('lam_f'),
        lam_g=ca.MX.sym('lam_g', N * (nx + problem.ng) + problem.nh),
    )


def _split(problem, symbols):
    N, nw = problem.horizon, problem.nx + problem.nu
    P = ca.reshape(symbols.p, problem.np, N + 1)
    return _Stages(
        W=ca.reshape(symbols.v[: N * nw], nw, N),
        w_last=symbols.v[N * nw :],
        P=P[:, :N],
        p_last=P[:, N],
    )


def _split_multipliers(problem, symbols):
    """Return the extra arguments of the Lagrangian of the stages and of the last stage."""
    N, nc = problem.horizon, problem.nx + problem.ng
    lam_c = ca.reshape(symbols.lam_g[: N * nc], nc, N)
    lam_dynamics = lam_c[: problem.nx, :]
    before = ca.horzcat(ca.MX.zeros(problem.nx, 1), lam_dynamics[:, : N - 1])
    return (
        (ca.repmat(symbols.lam_f, 1, N), lam_c, before),
        (symbols.lam_f, symbols.lam_g[N * nc :], lam_dynamics[:, N - 1]),
    )


def _close_gaps(problem, stages, C, c_last):
    """Complete c = [-F; g] of all stages with the next states to the constraints of the NLP."""
    nx = problem.nx
    x_next = ca.horzcat(stages.W[:nx, 1:], stages.w_last)
    return ca.vertcat(ca.vec(ca.vertcat(C[:nx, :] + x_next, C[nx:, :])), c_last)


def _values(problem, stage, last, stages):
    f = ca.sum2(stage.cost.map(problem.horizon)(stages.W, stages.P))
    C = stage.constraints.map(problem.horizon)(stages.W, stages.P)
    c_last = last.constraints(stages.w_last, stages.p_last)
    g = _close_gaps(problem, stages, C, c_last)
    return f + last.cost(stages.w_last, stages.p_last), g


def _lagrangian(problem, stage, last, stages, multipliers):
    stage_multipliers, last_multipliers = multipliers
    F, C, S = stage.lagrangian.map(problem.horizon)(stages.W, stages.P, *stage_multipliers)
    f_last, c_last, s_last = last.lagrangian(stages.w_last, stages.p_last, *last_multipliers)
    g = _close_gaps(problem, stages, C, c_last)
    no_gradient = ca.MX((problem.horizon + 1) * problem.np, 1)
    gradient = ca.vertcat(ca.vec(S), s_last)
    return {'f': ca.sum2(F) + f_last, 'g': g, 'grad_gamma_x': gradient, 'grad_gamma_p': no_gradient}


def _jacobian(problem, stage, last, stages, guarded):
    """Return the constraints and their Jacobian.

    `guarded`: where the growth reaches fatrop_guard.MAX_GROWTH, only the columns of the next states
    are not zero. fatrop then still counts its iterations and evaluates the deadline.
    """
    N, nc = problem.horizon, problem.nx + problem.ng
    C, J = stage.jacobian.map(N)(stages.W, stages.P)
    c_last, j_last = last.jacobian(stages.w_last, stages.p_last)
    pattern = stage.jacobian_pattern
    first = [i for i, row in enumerate(pattern.row()) if row >= nc]  # no stage before stage 0
    first_pattern = ca.vertsplit(pattern, [0, nc, 2 * nc])[1]
    height = N * nc + problem.nh

    def place(block, row):
        below = height - row - block.size1()
        width = block.size2()
        return ca.vertcat(ca.Sparsity(row, width), block, ca.Sparsity(below, width))

    columns = [place(first_pattern, 0)]
    columns += [place(pattern, k * nc) for k in range(N - 1)]
    columns += [place(last.jacobian_pattern, (N - 1) * nc)]
    if guarded:
        small = fatrop_guard.growth(problem, stage, last, J, j_last) < fatrop_guard.MAX_GROWTH
        before, before_last = (
            ca.DM([float(row < nc) for row in block.row()])
            for block in (pattern, last.jacobian_pattern)
        )
        J = ca.if_else(small, J, ca.repmat(before, 1, N))
        j_last = ca.if_else(small, j_last, before_last)
    nonzeros = ca.vertcat(J[first, 0], ca.vec(J[:, 1:]), j_last)
    g = _close_gaps(problem, stages, C, c_last)
    return g, ca.sparsity_cast(nonzeros, ca.horzcat(*columns))


def _hessian(problem, stage, last, stages, multipliers):
    stage_multipliers, last_multipliers = multipliers
    S, H = stage.hessian.map(problem.horizon)(stages.W, stages.P, *stage_multipliers)
    s_last, h_last = last.hessian(stages.w_last, stages.p_last, *last_multipliers)
    pattern = ca.diagcat(*[stage.hessian_pattern] * problem.horizon, last.hessian_pattern)
    nonzeros = ca.vertcat(ca.vec(H), h_last)
    return ca.vertcat(ca.vec(S), s_last), ca.sparsity_cast(nonzeros, pattern)


def _guard_hessian(symbols, hessian):
    """Return the Hessian for fatrop: zero where the weight lam_f of the cost is zero.

    fatrop sets this weight in its restoration phase, and adds a convex term of its own. Given the
    curvature of the constraints there, it can raise its inertia correction without end, on finite
    numbers. The Hessian is also zero where that correction would overflow before it is large
    enough.
    """
    small = ca.norm_1(hessian.nz[:]) < MAX_HESSIAN
    return ca.if_else(ca.logic_and(symbols.lam_f != 0, small), hessian, 0)
