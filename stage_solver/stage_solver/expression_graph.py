"""CasADi functions as one graph of numbered operations without common subexpressions.

Equal operations are one node (value numbering, Cocke & Schwartz 1970), divisions by the same number
share one reciprocal, and nodes that depend on parameters alone are marked: they are computed once
per solve instead of once per iteration.
"""

from collections.abc import Iterable
from typing import NamedTuple

import casadi as ca

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
