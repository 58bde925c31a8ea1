"""Refuses cost terms that contradict each other, the parameters, or what a term is.

Whether their derivatives can be used, `problem_check` tells.
"""

from collections.abc import Sequence
from keyword import iskeyword
from typing import Any

import casadi as ca
import numpy as np

from mpcc_controller.parameters import ControllerParams
from msgs_yaml.strict_yaml import closest
from node_runtime import parameters
from node_runtime.parameters import ParameterError

TOLERANCES, PRIORITIES = GROUPS = ('tolerances.', 'priorities.')  # of the parameters of weights


class CostTermError(ParameterError):
    """A cost term cannot be used; the text names it and says how to mend it."""


def check_list(terms: Sequence[Any], params: ControllerParams) -> None:
    """Raise CostTermError for what is wrong with `CostTerm`s of a formulation and their weights.

    Two of one name, a parameter that does not exist or gives no weight, and an optional parameter
    that is given but that no term uses.
    """
    seen: dict[str, Any] = {}
    known = parameters.flatten(params)
    weights_of = [name for name in known if name.startswith(GROUPS)]
    for term in terms:
        if not term.name.isidentifier() or term.name.startswith('_') or iskeyword(term.name):
            raise CostTermError(
                f'{term.title}: its name must be a Python identifier that does not begin with _'
            )
        other = seen.setdefault(term.name, term)
        if other is not term:
            raise CostTermError(
                f'{term.title}: {other.title} has the same name; columns, weights and reports go '
                'by it, so give it another one'
            )
        if term.parameter not in weights_of:
            hint = closest(term.parameter, weights_of)
            raise CostTermError(
                f'{term.title}: there is no such parameter{hint}; its weight needs one of '
                '`Tolerances` or `Priorities` in parameters.py'
            )
        for group, name in (('formulation', term.switch), ('envelope', term.limit)):
            if name and f'{group}.{name}' not in known:
                raise CostTermError(f"{term.title}: there is no parameter '{group}.{name}'")
        value = known[term.parameter]
        if value is None:
            continue
        if term.parameter.startswith(PRIORITIES):
            if not 0 <= value < np.inf:
                raise CostTermError(f'{term.title}: its weight is {value:g}; allowed from 0')
        elif not value > 0:
            raise CostTermError(
                f'{term.title}: its tolerance is {value:g}; allowed above 0: weight = 1/tolerance^2'
            )
    used = {term.parameter for term in terms}
    leaves = parameters.leaves(ControllerParams)
    for name in weights_of:
        if leaves[name].optional and known[name] is not None and name not in used:
            raise CostTermError(
                f'{name}: is {known[name]:g}, but no cost term of the formulation '
                f'{params.formulation.name} uses it: put its CostTerm into INPUTS, MPCC or FRENET '
                'of problem/cost_terms.py, or leave the parameter out'
            )


def squared_error(term: Any, quantities: Any) -> Any:
    """Return the squared error of a `CostTerm`, a number or an expression of one.

    Raises CostTermError where it cannot be computed, or is anything else.
    """
    try:
        error = term.squared_error(quantities)
    except Exception as fault:
        raise CostTermError(f'{term.title}: {_explain(fault, quantities)}') from fault
    if isinstance(error, ca.SX | ca.MX | ca.DM):
        size = f'{error.size1()} x {error.size2()} numbers' if error.numel() != 1 else ''
    else:
        is_number = np.asarray(error).dtype.kind in 'fiu' and not isinstance(error, list | tuple)
        size = '' if is_number else f'of type {type(error).__name__}'
    if size:
        raise CostTermError(
            f'{term.title}: its squared error is {size}; it must be one number: '
            'add the squares of several errors'
        )
    return error


def _explain(fault, quantities):
    """Return what an exception in a squared error means."""
    missing, owner = getattr(fault, 'name', None), getattr(fault, 'obj', None)
    if isinstance(fault, AttributeError) and owner is None and quantities.u is None:
        return (
            f'it uses the input (q.u.{missing}), which the last stage does not have; '
            'say uses_input=True'
        )
    if isinstance(fault, AttributeError) and hasattr(owner, '_fields'):
        known = owner._fields
        return f'there is no {missing!r}{closest(missing, known)}; there are {", ".join(known)}'
    hint = ''
    if 'Cannot compute the truth value' in str(fault) or '__bool__' in str(fault):
        hint = '; a term is an expression, use ca.if_else in place of if, and, or and max'
    lines = str(fault).strip().splitlines()
    return ': '.join([type(fault).__name__, *lines[-1:]]) + hint
