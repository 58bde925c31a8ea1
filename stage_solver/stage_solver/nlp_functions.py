"""The functions of the whole NLP, made of N calls of one stage's functions.

Variables v = [x_0; u_0; x_1; u_1; ...; x_N], constraints [x_1 - F_0; g_0; x_2 - F_1; ...; h], the
order in which fatrop sees the stages (Vanroye et al. 2023, https://arxiv.org/abs/2303.16746);
parameters are the stages' parameters one after the other. The stage functions stay calls (a loop
in the generated C): the expanded graph of 50 stages is ten times the code, takes minutes to compile
and runs slower.
"""

from typing import NamedTuple

import casadi as ca

from stage_solver import reuse, riccati_growth, stage_functions
from stage_solver.stage_problem import StageProblem

LARGEST_HESSIAN = 1e100  # sum of all magnitudes; far from both any problem and overflow


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


@reuse.once
def build(problem: StageProblem, solver: str) -> dict[str, ca.Function]:
    """Return the functions that CasADi's nlpsol looks for, under the names it looks for.

    solver is 'fatrop' or 'ipopt': they want the gradient and the Hessian in different forms.
    `nlp` is the problem itself, `nlp_grad` is (v, p, lam_f, lam_g) -> f, g, gradient of the
    Lagrangian; its fourth output, the gradient in p, is left empty because nobody asks for it.
    fatrop's Hessian is 0 where the cost has no weight (`_without_cost`), and its Jacobian where its
    recursion would fail (`riccati_growth`).
    """
    stage, last = stage_functions.stage(problem), stage_functions.last_stage(problem)
    symbols = _symbols(problem)
    stages = _split(problem, symbols)
    f, g = _values(problem, stage, last, stages)
    gradient = ca.vertcat(
        ca.vec(stage.gradient.map(problem.horizon)(stages.W, stages.P)),
        last.gradient(stages.w_last, stages.p_last),
    )
    g_again, jacobian = _jacobian(problem, stage, last, stages, guarded=solver == 'fatrop')
    multipliers = _split_multipliers(problem, symbols)
    slope, hessian = _hessian(problem, stage, last, stages, multipliers)
    if solver == 'fatrop':
        hessian = _without_cost(symbols, hessian)
    vp = [symbols.v, symbols.p]
    vpl = [*vp, symbols.lam_f, symbols.lam_g]
    triangle = solver == 'ipopt'
    outputs = {
        'nlp': (vp, ['x', 'p'], [f, g], ['f', 'g']),
        'nlp_f': (vp, ['x', 'p'], [f], ['f']),
        'nlp_g': (vp, ['x', 'p'], [g], ['g']),
        'nlp_grad_f': (vp, ['x', 'p'], [f, gradient], ['f', 'grad_f_x'])
        if triangle
        else (vp, ['x', 'p'], [gradient], ['grad_f_x']),
        'nlp_jac_g': (vp, ['x', 'p'], [g_again, jacobian], ['g', 'jac_g_x']),
        'nlp_hess_l': (vpl, _LAGRANGIAN_IN, [ca.triu(hessian)], ['triu_hess_gamma_x_x'])
        if triangle
        else (vpl, _LAGRANGIAN_IN, [slope, hessian], ['grad_gamma_x', 'hess_gamma_x_x']),
        'nlp_grad': (vpl, _LAGRANGIAN_IN, *_lagrangian(problem, stage, last, stages, multipliers)),
    }
    return {n: ca.Function(n, i, o, ni, no) for n, (i, ni, o, no) in outputs.items()}


_LAGRANGIAN_IN = ['x', 'p', 'lam_f', 'lam_g']


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
    of_stages, of_last = multipliers
    F, C, S = stage.lagrangian.map(problem.horizon)(stages.W, stages.P, *of_stages)
    f_last, c_last, s_last = last.lagrangian(stages.w_last, stages.p_last, *of_last)
    g = _close_gaps(problem, stages, C, c_last)
    no_gradient = ca.MX((problem.horizon + 1) * problem.np, 1)
    outputs = [ca.sum2(F) + f_last, g, ca.vertcat(ca.vec(S), s_last), no_gradient]
    return outputs, ['f', 'g', 'grad_gamma_x', 'grad_gamma_p']


def _jacobian(problem, stage, last, stages, guarded):
    """Return the constraints and their Jacobian.

    `guarded`: where the growth reaches riccati_growth.LARGEST, only the next states depend on
    anything. The solver then still counts its iterations and calls the deadline.
    """
    N, nc = problem.horizon, problem.nx + problem.ng
    C, J = stage.jacobian.map(N)(stages.W, stages.P)
    c_last, j_last = last.jacobian(stages.w_last, stages.p_last)
    pattern = stage.jacobian_pattern
    first = [i for i, row in enumerate(pattern.row()) if row >= nc]  # nothing comes before stage 0
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
        small = riccati_growth.growth(problem, stage, last, J, j_last) < riccati_growth.LARGEST
        before, before_last = (
            ca.DM([float(row < nc) for row in of.row()]) for of in (pattern, last.jacobian_pattern)
        )
        J = ca.if_else(small, J, ca.repmat(before, 1, N))
        j_last = ca.if_else(small, j_last, before_last)
    nonzeros = ca.vertcat(J[first, 0], ca.vec(J[:, 1:]), j_last)
    g = _close_gaps(problem, stages, C, c_last)
    return g, ca.sparsity_cast(nonzeros, ca.horzcat(*columns))


def _hessian(problem, stage, last, stages, multipliers):
    of_stages, of_last = multipliers
    S, H = stage.hessian.map(problem.horizon)(stages.W, stages.P, *of_stages)
    s_last, h_last = last.hessian(stages.w_last, stages.p_last, *of_last)
    pattern = ca.diagcat(*[stage.hessian_pattern] * problem.horizon, last.hessian_pattern)
    nonzeros = ca.vertcat(ca.vec(H), h_last)
    return ca.vertcat(ca.vec(S), s_last), ca.sparsity_cast(nonzeros, pattern)


def _without_cost(symbols, hessian):
    """Return the Hessian for fatrop: none where the cost counts for nothing.

    So it asks in its restoration phase, and adds a convex term of its own. Given the curvature of
    the constraints there, it was seen to raise its inertia correction for ever, on finite numbers.
    None either where that correction would overflow before it outweighs the Hessian.
    """
    small = ca.norm_1(hessian.nz[:]) < LARGEST_HESSIAN
    return ca.if_else(ca.logic_and(symbols.lam_f != 0, small), hessian, 0)
