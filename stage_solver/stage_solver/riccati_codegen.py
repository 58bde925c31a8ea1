"""The C source of a problem's riccati solver: sizes, tables and stage functions, then the method.

Steps: stage functions with derivatives (here) -> `vector_codegen` -> one C file with the
problem-independent parts in riccati_c/.

With w = [u; x] in solver units, the multipliers `lam` of the dynamics and `y` of the constraints,

    L = l(w, p) + lam' F(w, p) + y' g(w, p).

`sigma` and `push` are the curvature and the gradient of the barrier in w and in the slacks of g
(docs/solver.md, eq. 5); the matrix H and the vector q of the quadratic programme include them.
"""

from functools import lru_cache
from importlib import resources
from typing import NamedTuple

import casadi as ca

from stage_solver import vector_codegen
from stage_solver.stage_problem import MAX_CACHED_PROBLEMS, StageProblem

TEMPLATES = ('stages.h', 'barrier.h', 'riccati.h', 'search.h', 'call.h', 'solve.c')
# IEEE arithmetic; only errno and traps are given up, which vectors do not have
FLAGS = (
    '-std=gnu11',
    '-O2',
    '-march=native',
    '-ftree-vectorize',
    '-fno-math-errno',
    '-fno-trapping-math',
    '-fno-strict-aliasing',
    '-Wno-psabi',
)
SYSTEM_HEADERS = '#include <stddef.h>\n#include <string.h>\n#include <time.h>\n'
ONCE_INPUTS = {'p'}  # constant during a solve


class StageModel(NamedTuple):
    """The functions of one kind of stage that the solver evaluates, with exact derivatives."""

    values: ca.Function  # (w, p) -> F, cost, g
    quadratic: ca.Function  # (w, p, lam, y, sigma, push) -> q, H (upper triangle), JF, Jg
    slope: ca.Function  # (w, p, lam, y) -> dL/dw


def evaluate_stage(problem: StageProblem, x: ca.SX, u: ca.SX, p: ca.SX) -> tuple[ca.SX, ...]:
    """Return next state, cost and g of a stage; states and inputs are in solver units."""
    scale_x = ca.DM(problem.scale_x)
    arguments = x * scale_x, u * ca.DM(problem.scale_u), p
    x_next = ca.vec(problem.dynamics(*arguments)) / scale_x
    return x_next, problem.stage_cost(*arguments), ca.vec(problem.constraints(*arguments))


def evaluate_last_stage(problem: StageProblem, x: ca.SX, p: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return cost and h of stage N; the state is in solver units."""
    x = x * ca.DM(problem.scale_x)
    return problem.terminal_cost(x, p), ca.vec(problem.terminal_constraints(x, p))


def make_stage(problem: StageProblem, last: bool = False) -> StageModel:
    """Return the functions of stages 0..N-1, or of stage N.

    At the last one w is the state alone, and there are no dynamics.
    """
    name, nu = ('last', 0) if last else ('stage', problem.nu)
    w, p = ca.SX.sym('w', nu + problem.nx), ca.SX.sym('p', problem.np)
    if last:
        F, cost, g = ca.SX(0, 1), *evaluate_last_stage(problem, w, p)
    else:
        F, cost, g = evaluate_stage(problem, w[nu:], w[:nu], p)
    F, cost, g = (ca.densify(v) for v in (F, cost, g))
    n, n_g = w.numel(), g.numel()
    lam, y = ca.SX.sym('lam', F.numel()), ca.SX.sym('y', n_g)
    sigma, push = ca.SX.sym('sigma', n + n_g), ca.SX.sym('push', n + n_g)
    slope = ca.gradient(cost + ca.dot(lam, F) + ca.dot(y, g), w)
    JF, Jg = ca.jacobian(F, w), ca.jacobian(g, w)
    H = ca.jacobian(slope, w, {'symmetric': True})
    H += ca.diag(sigma[:n]) + Jg.T @ ca.diag(sigma[n:, :]) @ Jg
    q = ca.gradient(cost, w) + push[:n] + Jg.T @ push[n:, :]  # push[1:] of one row would be 1 x 0
    inputs = {'w': w, 'p': p, 'lam': lam, 'y': y, 'sigma': sigma, 'push': push}

    def function(kind, names_in, outputs):
        arguments = [inputs[n] for n in names_in]
        return ca.Function(f'{name}_{kind}', arguments, [*outputs.values()], names_in, [*outputs])

    return StageModel(
        values=function('values', ['w', 'p'], {'F': F, 'cost': cost, 'g': g}),
        quadratic=function(
            'quadratic', [*inputs], {'q': ca.densify(q), 'H': ca.triu(H), 'JF': JF, 'Jg': Jg}
        ),
        slope=function('slope', ['w', 'p', 'lam', 'y'], {'slope': ca.densify(slope)}),
    )


@lru_cache(MAX_CACHED_PROBLEMS)
def source(problem: StageProblem) -> str:
    """Return one C file; it exports riccati_solve and the sizes of its two structures.

    The compiler needs -DW=..., the number of lanes of a vector.
    """
    models = {'stage': make_stage(problem), 'last': make_stage(problem, last=True)}
    strides = {'stage': 'LANES', 'last': 'W'}
    functions = []
    sizes = {
        'N': problem.horizon,
        'NX': problem.nx,
        'NU': problem.nu,
        'NP': problem.np,
        'NG': max(problem.ng, problem.nh),
        'STAGE_NG': problem.ng,
        'LAST_NG': problem.nh,
    }
    for name, model in models.items():
        emitter = vector_codegen.Emitter(
            vector_codegen.ExpressionGraph(list(model), ONCE_INPUTS), name, strides[name]
        )
        functions.append(emitter.source())
        sizes[f'{name.upper()}_ONCE'] = len(emitter.once_rows)
    defines = '\n'.join(f'#define {name} {size}' for name, size in sizes.items())
    tables = [
        f'static const double SCALE_{name}[] = {{{", ".join(repr(float(s)) for s in scale)}}};'
        for name, scale in (('X', problem.scale_x), ('U', problem.scale_u))
    ]
    for kind, names in (('stage', ('H', 'JF', 'Jg')), ('last', ('H', 'Jg'))):
        for name in names:
            sparsity = models[kind].quadratic.sparsity_out(name)
            tables.append(_pattern(f'{kind.upper()}_{name}', sparsity))
    head = [SYSTEM_HEADERS, defines, *tables, template('vector_math.h'), template('workspace.h')]
    return '\n'.join([*head, *functions, *map(template, TEMPLATES)])


def template(name: str) -> str:
    """Return one of the problem-independent C files."""
    return resources.files('stage_solver').joinpath('riccati_c', name).read_text()


def _pattern(name, sparsity):
    """Return rows and columns of the non-zeros; one entry more, as C has no empty arrays."""
    rows, columns = sparsity.get_triplet()
    lists = {'ROW': [*rows, 0], 'COL': [*columns, 0]}
    lines = [f'#define {name}_NZ {len(rows)}']
    for key, indices in lists.items():
        lines.append(f'static const short {name}_{key}[] = {{{", ".join(map(str, indices))}}};')
    return '\n'.join(lines)
