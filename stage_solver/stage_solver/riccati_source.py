"""The C source of a problem's solver: its sizes and stage functions, then the method itself."""

from importlib import resources

from stage_solver import reuse, riccati_codegen, riccati_graph, riccati_model
from stage_solver.stage_problem import StageProblem

PARTS = ('stages.h', 'barrier.h', 'riccati.h', 'search.h', 'call.h', 'solve.c')
# The mathematics stays IEEE: only errno and traps are given up, which vectors do not have.
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
SYSTEM = '#include <stddef.h>\n#include <string.h>\n#include <time.h>\n'


@reuse.once
def source(problem: StageProblem) -> str:
    """Return one C file; it exports riccati_solve and the sizes of its two structures.

    The compiler must be told W, the number of lanes of a vector.
    """
    models = {'stage': riccati_model.stage(problem), 'last': riccati_model.last(problem)}
    strides = {'stage': 'LANES', 'last': 'W'}
    sizes, functions = _sizes(problem), []
    for name, model in models.items():
        graph = riccati_graph.Graph(list(model), riccati_model.ONCE_INPUTS)
        emitter = riccati_codegen.Emitter(graph, name, strides[name])
        functions.append(emitter.source())
        sizes[f'{name.upper()}_ONCE'] = len(emitter.kept)
    defines = '\n'.join(f'#define {name} {size}' for name, size in sizes.items())
    tables = [_scale('SCALE_X', problem.scale_x), _scale('SCALE_U', problem.scale_u)]
    for kind, names in (('stage', ('H', 'JF', 'Jg')), ('last', ('H', 'Jg'))):
        for name in names:
            sparsity = models[kind].quadratic.sparsity_out(name)
            tables.append(_pattern(f'{kind.upper()}_{name}', sparsity))
    parts = [SYSTEM, defines, *tables, part('vector_math.h'), part('workspace.h')]
    return '\n'.join([*parts, *functions, *map(part, PARTS)])


def _sizes(problem):
    return {
        'N': problem.horizon,
        'NX': problem.nx,
        'NU': problem.nu,
        'NP': problem.np,
        'NG': max(problem.ng, problem.nh),
        'STAGE_NG': problem.ng,
        'LAST_NG': problem.nh,
    }


def _scale(name, values):
    return f'static const double {name}[] = {{{", ".join(map(repr, map(float, values)))}}};'


def _pattern(name, sparsity):
    """Return rows and columns of the non-zeros; one entry more, as C has no empty arrays."""
    rows, columns = sparsity.get_triplet()
    lists = {'ROW': [*rows, 0], 'COL': [*columns, 0]}
    text = [f'#define {name}_NZ {len(rows)}']
    for key, numbers in lists.items():
        text.append(f'static const short {name}_{key}[] = {{{", ".join(map(str, numbers))}}};')
    return '\n'.join(text)


def part(name: str) -> str:
    """Return one of the C files that are the same for every problem."""
    return resources.files('stage_solver').joinpath('riccati_c', name).read_text()
