"""An expression graph as C functions on vectors, one lane per stage.

The C code uses GCC's vector extension (V: doubles, M: the masks that comparisons give) and the
functions of riccati_c/vector_math.h. A branch becomes a mask, so every lane takes the same path.
"""

import casadi as ca

from stage_solver.expression_graph import ExpressionGraph
from stage_solver.stage_problem import ProblemError

# {0}, {1} are the C names of the operands
EXPRESSIONS = {
    ca.OP_ADD: '{0} + {1}',
    ca.OP_SUB: '{0} - {1}',
    ca.OP_MUL: '{0} * {1}',
    ca.OP_INV: '1.0 / {0}',
    ca.OP_NEG: '-{0}',
    ca.OP_SQ: '{0} * {0}',
    ca.OP_TWICE: '{0} + {0}',
    ca.OP_ASSIGN: '{0}',
    ca.OP_LIFT: '{0}',
    ca.OP_SQRT: 'v_sqrt({0})',
    ca.OP_SIN: 'v_sin({0})',
    ca.OP_COS: 'v_cos({0})',
    ca.OP_TAN: 'v_tan({0})',
    ca.OP_ATAN: 'v_atan({0})',
    ca.OP_EXP: 'v_exp({0})',
    ca.OP_LOG: 'v_log({0})',
    ca.OP_TANH: 'v_tanh({0})',
    ca.OP_FABS: 'v_abs({0})',
    ca.OP_FMIN: 'v_min({0}, {1})',
    ca.OP_FMAX: 'v_max({0}, {1})',
    ca.OP_SIGN: 'v_sign({0})',
    ca.OP_COPYSIGN: 'v_copysign({0}, {1})',
    ca.OP_LT: '{0} < {1}',
    ca.OP_LE: '{0} <= {1}',
    ca.OP_EQ: '{0} == {1}',
    ca.OP_NE: '{0} != {1}',
    ca.OP_NOT: '~{0}',
    ca.OP_AND: '{0} & {1}',
    ca.OP_OR: '{0} | {1}',
    ca.OP_IF_ELSE_ZERO: 'v_where({0}, {1})',
}
# functions that vector_math.h takes from the C library, lane by lane
EXPRESSIONS |= {
    getattr(ca, f'OP_{name.upper()}'): f'v_each(w_{name}, {{0}})'
    for name in (
        *('asin', 'acos', 'sinh', 'cosh', 'asinh', 'acosh', 'atanh'),
        *('erf', 'log1p', 'expm1', 'floor', 'ceil'),
    )
}
EXPRESSIONS |= {
    getattr(ca, f'OP_{name.upper()}'): f'v_each2(w_{name}, {{0}}, {{1}})'
    for name in ('pow', 'atan2', 'fmod', 'hypot')
}
EXPRESSIONS[ca.OP_CONSTPOW] = EXPRESSIONS[ca.OP_POW]
COMPARISONS = {ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE}
LOGIC = {ca.OP_NOT, ca.OP_AND, ca.OP_OR}


class UnsupportedError(ProblemError):
    """A CasADi operation has no counterpart in the generated C."""


class Emitter:
    """Emits the functions of one graph; `stride` is the number of doubles between two rows.

    Values that depend on the once-inputs alone are computed by the function `<name>_once`, which
    stores them in the array `once`; all other functions read them from it. `once_rows` is the row
    of each of these nodes.
    """

    def __init__(self, graph: ExpressionGraph, name: str, stride: str):
        self.graph, self.name, self.stride = graph, name, stride
        self.once_rows: dict[int, int] = {}
        for outputs in graph.roots.values():
            roots = _flatten(outputs)
            needed = [n for n in roots if self._is_stored(n)]
            for node in graph.reachable(roots):
                if not graph.is_once(node):
                    needed += [a for a in graph.arguments(node) if self._is_stored(a)]
            for node in needed:
                self.once_rows.setdefault(node, len(self.once_rows))

    def source(self) -> str:
        """Return the C functions `<name>_once`, and one per function of the graph."""
        parts = [self._once()]
        parts += [self._function(name, outputs) for name, outputs in self.graph.roots.items()]
        return '\n'.join(parts)

    def _is_stored(self, node):
        return self.graph.is_once(node) and self.graph.nodes[node].op not in (
            ca.OP_INPUT,
            ca.OP_CONST,
        )

    def _once(self):
        body = [self._statement(n, ()) for n in self.graph.reachable(self.once_rows)]
        for node, row in self.once_rows.items():
            body.append(f'{self._at("once", row)} = {self._number(node, ())};')
        return _definition(f'{self.name}_once', ['p'], ['once'], body)

    def _function(self, name, outputs):
        roots = _flatten(outputs)
        inner = {n for n in self.graph.reachable(roots) if not self.graph.is_once(n)}
        border = {a for n in inner for a in self.graph.arguments(n)} | set(roots)
        body = []
        for node in sorted(inner | border):
            if node in self.once_rows:
                body.append(f'const V t{node} = {self._at("once", self.once_rows[node])};')
            else:
                body.append(self._statement(node, self.once_rows))
        for output, rows in outputs.items():
            for row, node in enumerate(rows):
                body.append(f'{self._at(output, row)} = {self._number(node, self.once_rows)};')
        inputs = [i for i in self.graph.inputs[name] if i != 'p']
        return _definition(name, ['p', 'once', *inputs], list(outputs), body)

    def _statement(self, node, loaded):
        """Return the C that computes a node; the array `once` has masks of `loaded` as numbers."""
        op, args = self.graph.nodes[node]
        if op == ca.OP_INPUT:
            return f'const V t{node} = {self._at(*args)};'
        if op == ca.OP_CONST:
            return f'const V t{node} = v_all({_literal(args[0])});'
        if op not in EXPRESSIONS:
            raise UnsupportedError(f'{self.name}: CasADi operation {op} is not supported')
        n_masks = len(args) if op in LOGIC else op == ca.OP_IF_ELSE_ZERO  # the first operands
        names = [self._mask(a, loaded) for a in args[:n_masks]]
        names += [self._number(a, loaded) for a in args[n_masks:]]
        kind = 'M' if self._is_mask(node, ()) else 'V'
        return f'const {kind} t{node} = {EXPRESSIONS[op].format(*names)};'

    def _is_mask(self, node, loaded):
        return node not in loaded and self.graph.nodes[node].op in COMPARISONS | LOGIC

    def _number(self, node, loaded):
        return f'v_where(t{node}, v_all(1.0))' if self._is_mask(node, loaded) else f't{node}'

    def _mask(self, node, loaded):
        return f't{node}' if self._is_mask(node, loaded) else f'(t{node} != 0.0)'

    def _at(self, array, row):
        return f'*(V *)({array} + {row} * {self.stride})'


def _flatten(outputs):
    return [node for nodes in outputs.values() for node in nodes]


def _definition(name, inputs, outputs, body):
    arguments = [f'const double *restrict {a}' for a in inputs]
    arguments += [f'double *restrict {a}' for a in outputs]
    lines = '\n    '.join(body)
    return f'static void {name}({", ".join(arguments)})\n{{\n    {lines}\n}}\n'


def _literal(value):
    if value != value:
        return '__builtin_nan("")'
    if value in (float('inf'), float('-inf')):
        return f'{"-" if value < 0 else ""}__builtin_inf()'
    return repr(float(value))
