"""A graph of operations as C on vectors, one lane per stage.

The C uses GCC's vector extension (V: doubles, M: the masks that comparisons give) and the
functions of riccati_c/vector_math.h. A branch becomes a mask, so every lane takes the same path.
"""

import casadi as ca

from stage_solver.riccati_graph import Graph
from stage_solver.stage_problem import ProblemError

# arguments are the C names of the nodes that the operation works on
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
# what vector_math.h leaves to the C library, lane by lane
EXPRESSIONS |= {
    op: f'v_each(w_{name}, {{0}})'
    for op, name in {
        ca.OP_ASIN: 'asin',
        ca.OP_ACOS: 'acos',
        ca.OP_SINH: 'sinh',
        ca.OP_COSH: 'cosh',
        ca.OP_ASINH: 'asinh',
        ca.OP_ACOSH: 'acosh',
        ca.OP_ATANH: 'atanh',
        ca.OP_ERF: 'erf',
        ca.OP_LOG1P: 'log1p',
        ca.OP_EXPM1: 'expm1',
        ca.OP_FLOOR: 'floor',
        ca.OP_CEIL: 'ceil',
    }.items()
}
EXPRESSIONS |= {
    ca.OP_POW: 'v_each2(w_pow, {0}, {1})',
    ca.OP_CONSTPOW: 'v_each2(w_pow, {0}, {1})',
    ca.OP_ATAN2: 'v_each2(w_atan2, {0}, {1})',
    ca.OP_FMOD: 'v_each2(w_fmod, {0}, {1})',
    ca.OP_HYPOT: 'v_each2(w_hypot, {0}, {1})',
}
COMPARISONS = {ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE}
LOGIC = {ca.OP_NOT, ca.OP_AND, ca.OP_OR}


class UnsupportedError(ProblemError):
    """A CasADi operation has no counterpart in the generated C."""


class Emitter:
    """Writes the functions of one graph; `stride` is the number of doubles between two rows.

    Values that depend on the once-inputs alone are written to the array `once` by a function of
    its own, and read from there by all others.
    """

    def __init__(self, graph: Graph, name: str, stride: str):
        self.graph, self.name, self.stride = graph, name, stride
        self.kept = self._kept()

    def source(self) -> str:
        """Return the C functions `<name>_once`, and one per function of the graph."""
        parts = [self._once()]
        parts += [self._function(name, outputs) for name, outputs in self.graph.roots.items()]
        return '\n'.join(parts)

    def _kept(self):
        """Number the once-values that the other functions need."""
        kept = {}
        for outputs in self.graph.roots.values():
            roots = [n for rows in outputs.values() for n in rows]
            needed = [n for n in roots if self._is_stored(n)]
            for node in self.graph.reachable(roots):
                if not self.graph.is_once(node):
                    needed += [a for a in self.graph.arguments(node) if self._is_stored(a)]
            for node in needed:
                kept.setdefault(node, len(kept))
        return kept

    def _is_stored(self, node):
        return self.graph.is_once(node) and self.graph.nodes[node].op not in (
            ca.OP_INPUT,
            ca.OP_CONST,
        )

    def _once(self):
        body = [self._statement(n, ()) for n in self.graph.reachable(self.kept)]
        for node, row in self.kept.items():
            body.append(f'{self._at("once", row)} = {self._number(node, ())};')
        return _definition(f'{self.name}_once', ['p'], ['once'], body)

    def _function(self, name, outputs):
        roots = [n for rows in outputs.values() for n in rows]
        inner = {n for n in self.graph.reachable(roots) if not self.graph.is_once(n)}
        border = {a for n in inner for a in self.graph.arguments(n)} | set(roots)
        body = []
        for node in sorted(inner | border):
            if node in self.kept:
                body.append(f'const V t{node} = {self._at("once", self.kept[node])};')
            else:
                body.append(self._statement(node, self.kept))
        for output, rows in outputs.items():
            for row, node in enumerate(rows):
                body.append(f'{self._at(output, row)} = {self._number(node, self.kept)};')
        inputs = [i for i in self.graph.inputs[name] if i != 'p']
        return _definition(name, ['p', 'once', *inputs], list(outputs), body)

    def _statement(self, node, loaded):
        """Compute a node; those in `loaded` come from `once`, where masks are stored as numbers."""
        op, args = self.graph.nodes[node]
        if op == ca.OP_INPUT:
            return f'const V t{node} = {self._at(*args)};'
        if op == ca.OP_CONST:
            return f'const V t{node} = v_all({_literal(args[0])});'
        if op not in EXPRESSIONS:
            raise UnsupportedError(f'{self.name}: CasADi operation {op} is not supported')
        masks = len(args) if op in LOGIC else op == ca.OP_IF_ELSE_ZERO  # how many come first
        names = [self._mask(a, loaded) for a in args[:masks]]
        names += [self._number(a, loaded) for a in args[masks:]]
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
