"""CasADi functions as C functions on vectors, one lane per stage.

They become one graph of numbered operations without common subexpressions: equal operations are
one node (value numbering, Cocke & Schwartz 1970), divisions by the same number share one
reciprocal, and nodes that depend on parameters alone are computed once per solve, not once per
iteration.

The C code uses GCC's vector extension (V: doubles, M: the masks that comparisons give) and the
functions of riccati_c/vector_math.h. A branch becomes a mask, so every lane takes the same path.
"""

from collections.abc import Iterable
from typing import NamedTuple

import casadi as ca

from stage_solver.stage_problem import ProblemError

COMMUTATIVE = {ca.OP_ADD, ca.OP_MUL, ca.OP_FMIN, ca.OP_FMAX, ca.OP_EQ, ca.OP_NE}
MAX_POWER = 8  # larger integer exponents are not expanded into products


class Node(NamedTuple):
    """One operation: CasADi's code and its operands."""

    op: int
    args: tuple  # node numbers; (input name, row) for OP_INPUT; (value,) for OP_CONST


ONE = Node(ca.OP_CONST, (1.0,))


class ExpressionGraph:
    """The operations of several functions of the same inputs.

    `roots[function name][output name]` lists the node of every non-zero, in CasADi's order;
    `inputs[function name]` are the names of its arguments.
    """

    def __init__(self, functions: list[ca.Function], once_inputs: set[str]):
        self.nodes: list[Node] = []
        self.roots: dict[str, dict[str, list[int]]] = {}
        self._number: dict[Node, int] = {}
        self._once_inputs = once_inputs
        self._once: list[bool] = []
        self.inputs = {f.name(): f.name_in() for f in functions}
        expanded = [f if f.is_a('SXFunction') else f.expand() for f in functions]
        for function in expanded:
            self.roots[function.name()] = self._read(function)

    def is_once(self, node: int) -> bool:
        """Return whether a node depends on constants and the once-inputs alone."""
        return self._once[node]

    def reachable(self, roots: Iterable[int]) -> list[int]:
        """Return `roots` and all nodes that they depend on, every node after its operands."""
        visited, queue = set(), list(roots)
        while queue:
            node = queue.pop()
            if node not in visited:
                visited.add(node)
                queue += self.arguments(node)
        return sorted(visited)

    def arguments(self, node: int) -> tuple[int, ...]:
        """Return the operands of a node that are nodes."""
        op, args = self.nodes[node]
        return () if op in (ca.OP_INPUT, ca.OP_CONST) else args

    def _read(self, f):
        work = {}
        out = {f.name_out(i): [None] * f.nnz_out(i) for i in range(f.n_out())}
        for k in range(f.n_instructions()):
            op, args, to = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
            if op == ca.OP_OUTPUT:
                out[f.name_out(to[0])][to[1]] = work[args[0]]
            elif op == ca.OP_INPUT:
                row = f.sparsity_in(args[0]).row()[args[1]]
                work[to[0]] = self._add(op, (f.name_in(args[0]), row))
            elif op == ca.OP_CONST:
                work[to[0]] = self._add(op, (f.instruction_constant(k),))
            else:
                work[to[0]] = self._operation(op, tuple(work[a] for a in args))
        return out

    def _operation(self, op, args):
        if op == ca.OP_DIV:
            return self._operation(ca.OP_MUL, (args[0], self._add(ca.OP_INV, args[1:])))
        if op == ca.OP_MUL:
            others = [a for a in args if self.nodes[a] != ONE]
            if len(others) == 1:
                return others[0]
        if op in (ca.OP_POW, ca.OP_CONSTPOW):
            base, exponent = args
            if self.nodes[exponent].op == ca.OP_CONST:
                power = self.nodes[exponent].args[0]
                if power == int(power) and 1 <= abs(power) <= MAX_POWER:
                    product = self._power(base, int(abs(power)))
                    return product if power > 0 else self._add(ca.OP_INV, (product,))
        return self._add(op, args)

    def _power(self, base, exponent):
        if exponent == 1:
            return base
        half = self._power(base, exponent // 2)
        square = self._add(ca.OP_SQ, (half,))
        return self._add(ca.OP_MUL, (square, base)) if exponent % 2 else square

    def _add(self, op, args):
        if op in COMMUTATIVE:
            args = tuple(sorted(args))
        node = Node(op, args)
        if node not in self._number:
            self._number[node] = len(self.nodes)
            self.nodes.append(node)
            if op == ca.OP_INPUT:
                once = args[0] in self._once_inputs
            else:
                once = op == ca.OP_CONST or all(self._once[a] for a in args)
            self._once.append(once)
        return self._number[node]


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
    getattr(ca, f'OP_{name.upper()}'): f'v_each({name}, {{0}})'
    for name in (
        *('asin', 'acos', 'sinh', 'cosh', 'asinh', 'acosh', 'atanh'),
        *('erf', 'log1p', 'expm1', 'floor', 'ceil'),
    )
}
EXPRESSIONS |= {
    getattr(ca, f'OP_{name.upper()}'): f'v_each2({name}, {{0}}, {{1}})'
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
