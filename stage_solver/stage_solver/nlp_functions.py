"""The functions of the whole NLP, assembled from N calls of one stage's functions.

Variables v = [x_0; u_0; x_1; u_1; ...; x_N], constraints [x_1 - F_0; g_0; x_2 - F_1; ...; h], the
order that fatrop expects (Vanroye et al. 2023, https://arxiv.org/abs/2303.16746); parameters are
the stages' parameters in the order of the stages. The stage functions stay calls (a loop in the
generated C): the expanded graph of 50 stages is ten times the code, takes minutes to compile and
runs slower.
"""

from functools import lru_cache

import casadi as ca

from stage_solver import fatrop_guard, stage_functions
from stage_solver.stage_problem import MAX_CACHED_PROBLEMS, StageProblem

MAX_HESSIAN = 1e100  # sum of all magnitudes; far from both any problem and overflow


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
    nlp = _Assembly(problem)
    f, g = nlp.values()
    jacobian_g, jacobian = nlp.jacobian(guarded=solver == 'fatrop')
    gradient_l, hessian = nlp.hessian()
    if solver == 'fatrop':
        hessian = _guard_hessian(nlp.lam_f, hessian)
    outputs = {
        'nlp': {'f': f, 'g': g},
        'nlp_f': {'f': f},
        'nlp_g': {'g': g},
        'nlp_grad_f': {'grad_f_x': nlp.gradient()},
        'nlp_jac_g': {'g': jacobian_g, 'jac_g_x': jacobian},
        'nlp_hess_l': {'grad_gamma_x': gradient_l, 'hess_gamma_x_x': hessian},
        'nlp_grad': nlp.lagrangian(),
    }
    if solver == 'ipopt':
        outputs['nlp_grad_f'] = {'f': f} | outputs['nlp_grad_f']
        outputs['nlp_hess_l'] = {'triu_hess_gamma_x_x': ca.triu(hessian)}
    plan_inputs = {'x': nlp.v, 'p': nlp.p}
    lagrangian_inputs = plan_inputs | {'lam_f': nlp.lam_f, 'lam_g': nlp.lam_g}
    functions = {}
    for name, results in outputs.items():
        inputs = lagrangian_inputs if name in ('nlp_hess_l', 'nlp_grad') else plan_inputs
        arguments = [*inputs.values()], [*results.values()], [*inputs], [*results]
        functions[name] = ca.Function(name, *arguments)
    return functions


class _Assembly:
    """The symbols of the NLP, and the results of all stages in the order of its variables."""

    def __init__(self, problem: StageProblem):
        N, nx = problem.horizon, problem.nx
        nw, nc = nx + problem.nu, nx + problem.ng
        self.problem = problem
        self.stage = stage_functions.make_stage(problem)
        self.last = stage_functions.make_last_stage(problem)
        self.v = ca.MX.sym('x', N * nw + nx)
        self.p = ca.MX.sym('p', (N + 1) * problem.np)
        self.lam_f = ca.MX.sym('lam_f')
        self.lam_g = ca.MX.sym('lam_g', N * nc + problem.nh)
        W, w_last = ca.reshape(self.v[: N * nw], nw, N), self.v[N * nw :]
        P = ca.reshape(self.p, problem.np, N + 1)
        self.x_next = ca.horzcat(W[:nx, 1:], w_last)
        at, at_last = (W, P[:, :N]), (w_last, P[:, N])
        lam_c = ca.reshape(self.lam_g[: N * nc], nc, N)
        before = ca.horzcat(ca.MX.zeros(nx, 1), lam_c[:nx, : N - 1])
        multipliers = ca.repmat(self.lam_f, 1, N), lam_c, before
        last_multipliers = self.lam_f, self.lam_g[N * nc :], lam_c[:nx, N - 1]
        # arguments of the stages and of the last stage
        self._plain = at, at_last
        self._with_multipliers = (*at, *multipliers), (*at_last, *last_multipliers)

    def _evaluate(self, name, arguments):
        """Return the results of one of the StageFunctions at the stages, and at the last stage."""
        at, at_last = arguments
        at_stages = getattr(self.stage, name).map(self.problem.horizon)(*at)
        return at_stages, getattr(self.last, name)(*at_last)

    def _close_gaps(self, C, c_last):
        """Complete c = [-F; g] of all stages with the next states to the constraints of the NLP."""
        nx = self.problem.nx
        return ca.vertcat(ca.vec(ca.vertcat(C[:nx, :] + self.x_next, C[nx:, :])), c_last)

    def values(self):
        """Return the cost and the constraints."""
        F, f_last = self._evaluate('cost', self._plain)
        return ca.sum2(F) + f_last, self._close_gaps(*self._evaluate('constraints', self._plain))

    def gradient(self):
        """Return the gradient of the cost, dense: nlpsol leaves what has no entry uninitialised."""
        gradients, last = self._evaluate('gradient', self._plain)
        return ca.densify(ca.vertcat(ca.vec(gradients), last))

    def lagrangian(self):
        """Return the outputs of `nlp_grad`."""
        results = self._evaluate('lagrangian', self._with_multipliers)
        (F, C, S), (f_last, c_last, s_last) = results
        return {
            'f': ca.sum2(F) + f_last,
            'g': self._close_gaps(C, c_last),
            'grad_gamma_x': ca.vertcat(ca.vec(S), s_last),
            'grad_gamma_p': ca.MX(self.p.numel(), 1),
        }

    def jacobian(self, guarded: bool):
        """Return the constraints and their Jacobian.

        `guarded`: where the growth reaches fatrop_guard.MAX_GROWTH, only the columns of the next
        states are not zero. fatrop then still counts its iterations and evaluates the deadline.
        """
        problem, pattern = self.problem, self.stage.jacobian_pattern
        last_pattern = self.last.jacobian_pattern
        N, nc = problem.horizon, problem.nx + problem.ng
        (C, J), (c_last, j_last) = self._evaluate('jacobian', self._plain)
        first = [i for i, row in enumerate(pattern.row()) if row >= nc]  # no stage before stage 0
        first_pattern = ca.vertsplit(pattern, [0, nc, 2 * nc])[1]
        height = N * nc + problem.nh

        def place(block, row):
            below = height - row - block.size1()
            width = block.size2()
            return ca.vertcat(ca.Sparsity(row, width), block, ca.Sparsity(below, width))

        columns = [place(first_pattern, 0), *(place(pattern, k * nc) for k in range(N - 1))]
        columns.append(place(last_pattern, (N - 1) * nc))
        if guarded:
            growth = fatrop_guard.growth(problem, self.stage, self.last, J, j_last)
            small = growth < fatrop_guard.MAX_GROWTH
            before, before_last = (
                ca.DM([float(row < nc) for row in block.row()]) for block in (pattern, last_pattern)
            )
            J = ca.if_else(small, J, ca.repmat(before, 1, N))
            j_last = ca.if_else(small, j_last, before_last)
        nonzeros = ca.vertcat(J[first, 0], ca.vec(J[:, 1:]), j_last)
        g = self._close_gaps(C, c_last)
        return g, ca.sparsity_cast(nonzeros, ca.horzcat(*columns))

    def hessian(self):
        """Return gradient and Hessian of the Lagrangian."""
        (S, H), (s_last, h_last) = self._evaluate('hessian', self._with_multipliers)
        patterns = [self.stage.hessian_pattern] * self.problem.horizon
        pattern = ca.diagcat(*patterns, self.last.hessian_pattern)
        nonzeros = ca.vertcat(ca.vec(H), h_last)
        return ca.vertcat(ca.vec(S), s_last), ca.sparsity_cast(nonzeros, pattern)


def _guard_hessian(lam_f, hessian):
    """Return the Hessian for fatrop: zero where the weight lam_f of the cost is zero.

    fatrop sets this weight in its restoration phase, and adds a convex term of its own. Given the
    curvature of the constraints there, it can raise its inertia correction without end, on finite
    numbers. The Hessian is also zero where that correction would overflow before it is large
    enough.
    """
    small = ca.norm_1(hessian.nz[:]) < MAX_HESSIAN
    return ca.if_else(ca.logic_and(lam_f != 0, small), hessian, 0)
