"""Evaluates a Python function that was written for numbers on CasADi symbols.

The source of the function is executed as it is, statement by statement, with two differences: the
functions of `math` are those of CasADi, and both branches of an `if` are executed; every variable
that they leave different becomes `if_else(condition, then, otherwise)`. A branch that divides by
zero does no harm: `if_else` drops what it does not choose. An `if` that may return is the last
statement of its function, and both of its branches return.
Functions of `packages` that the function calls are treated alike.
"""

import ast
import inspect
import math
import textwrap
from collections.abc import Callable, Sequence
from functools import reduce
from types import FunctionType, ModuleType, SimpleNamespace
from typing import Any

import casadi as ca

_MATH = SimpleNamespace(
    **{name: getattr(ca, name) for name in ('sin', 'cos', 'tan', 'atan', 'sqrt', 'fabs')},
    pi=math.pi,
)
_RETURNED = 'return'  # no name of a variable


def evaluate(
    function: Callable, arguments: Sequence[Any], packages: Sequence[str]
) -> tuple[Any, dict[str, Any]]:
    """Return the result of a function of symbols, and its local variables at the end.

    packages: names of packages whose functions are treated in the same way. Raises ValueError for
    a statement that has no meaning for symbols.
    """
    definition = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    outside = {name: _replaced(v, packages) for name, v in function.__globals__.items()}
    names = [argument.arg for argument in definition.args.args]
    # lists are changed in place: those of the caller stay
    variables = _copied(dict(zip(names, arguments, strict=True)))
    _run(definition.body, variables, outside)
    return variables.pop(_RETURNED, None), variables


def _replaced(value, packages):
    """Return what takes the place of a global of the function."""
    if value is math:
        return _MATH
    if isinstance(value, ModuleType) and _is_within(value.__name__, packages):
        return SimpleNamespace(
            **{name: _replaced(inner, packages) for name, inner in vars(value).items()}
        )
    if isinstance(value, FunctionType) and _is_within(value.__module__, packages):
        return lambda *arguments: evaluate(value, arguments, packages)[0]
    return value


def _is_within(module, packages):
    return module.partition('.')[0] in packages


def _run(statements, variables, outside):
    for statement in statements:
        if isinstance(statement, ast.If):
            _branch(statement, variables, outside)
        elif isinstance(statement, ast.For):
            for value in _value(statement.iter, variables, outside):
                variables[statement.target.id] = value
                _run(statement.body, variables, outside)
        elif isinstance(statement, ast.Return):
            variables[_RETURNED] = _value(statement.value, variables, outside)
        else:
            module = ast.Module([statement], type_ignores=[])
            exec(compile(module, '<symbolic>', 'exec'), outside, variables)


def _value(expression, variables, outside):
    return eval(compile(ast.Expression(expression), '<symbolic>', 'eval'), outside, variables)


def _condition(expression, variables, outside):
    """Return the value of a condition; `and` and `or` of symbols take all their operands."""
    if not isinstance(expression, ast.BoolOp):
        return _value(expression, variables, outside)
    join = ca.logic_and if isinstance(expression.op, ast.And) else ca.logic_or
    operands = (_condition(operand, variables, outside) for operand in expression.values)
    return reduce(join, map(ca.SX, operands))


def _branch(statement, variables, outside):
    """Run both branches of an `if`."""
    condition = _condition(statement.test, variables, outside)
    then, otherwise = _copied(variables), _copied(variables)
    _run(statement.body, then, outside)
    _run(statement.orelse, otherwise, outside)
    if (_RETURNED in then) != (_RETURNED in otherwise):
        raise ValueError(f'line {statement.lineno}: one branch returns, the other one does not')
    # a variable of one branch only has no value behind it
    variables.clear()
    for name in then.keys() & otherwise.keys():
        variables[name] = _chosen(condition, then[name], otherwise[name])


def _copied(variables):
    return {k: list(v) if isinstance(v, list) else v for k, v in variables.items()}


def _chosen(condition, then, otherwise):
    if isinstance(then, list):
        pairs = zip(then, otherwise, strict=True)
        return [_chosen(condition, a, b) for a, b in pairs]
    if then is otherwise:
        return then
    if isinstance(then, int | float | ca.SX):
        return ca.if_else(condition, then, otherwise)
    if then == otherwise:
        return then
    raise ValueError(f'no choice between {then!r} and {otherwise!r}')
