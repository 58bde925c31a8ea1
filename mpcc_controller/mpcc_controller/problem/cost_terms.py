"""The terms of the cost: each a weight times a squared error (paper, eq. 4). SI units.

This is the one list of them. The parameters of the weights, the columns `cost.*` and `weight.*` of
/controller/why, and the reports follow from it. A new term is an entry here and its parameter in
`parameters.Tolerances`; docs/tutorials/06_own_cost_term.md shows how.

A weight is 1 / tolerance^2 for `tolerances.*`, and the value itself for `priorities.*`. A priority
of 0 switches a term off without another compilation. A term that is not `in_use` is not in the
problem at all: it costs no computing time, and the others are evaluated as before, bit for bit.
"""

from collections import namedtuple
from collections.abc import Callable, Sequence
from keyword import iskeyword
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from mpcc_controller.model import single_track
from mpcc_controller.parameters import FIXED, ControllerParams
from msgs_yaml.strict_yaml import closest
from node_runtime import parameters
from node_runtime.parameters import ParameterError

PRIORITY = 'priorities.'
GROUPS = ('tolerances.', PRIORITY)  # of the parameters of weights


class CostTermError(ParameterError):
    """A cost term cannot be used; the text names it and says how to mend it."""


class StageQuantities(NamedTuple):
    """What squared errors are computed from: numbers or CasADi expressions of one stage."""

    x: Any  # state of the formulation
    u: Any  # `Input`; None at the last stage
    p: Any  # parameters of the stage
    tracking: Any  # tracking errors of the formulation, a NamedTuple
    heading_error: Any  # rad
    v2o: Sequence[Sequence[Any]]  # m, D_V2O per obstacle and vehicle circle
    v2e: Sequence[Sequence[Any]]  # m, D_V2E per edge and vehicle circle
    priority: Callable  # (D, D_sft) -> q / P_k


class CostTerm(NamedTuple):
    """One term of the cost."""

    name: str  # in /controller/why: cost.NAME, weight.NAME
    parameter: str  # of the weight: tolerances.* or priorities.*
    squared_error: Callable[[StageQuantities], Any]
    uses_input: bool = False  # depends on the input; absent at the last stage
    switch: str = ''  # parameter of `formulation`; false sets the weight to 0
    optional: bool = False  # not in the paper; left out of the problem when it is off
    limit: str = ''  # parameter of `envelope` beyond which there is an error
    # parameter of `formulation` and its value with which the term is not in the problem
    absent_with: tuple[str, str] | None = None

    @property
    def title(self) -> str:
        """What errors call the term."""
        return f"cost term '{self.name}' ({self.parameter})"


# m; the step of the baseline's priority changes by 80 % within 2.2 of these, 4 cm: a solver that
# uses derivatives needs a continuous cost at contact
STEP_BLEND = 0.02
STRIP_BLEND_M = 0.5  # within it, at either side of a strip, the time gap comes to count


def gaussian_priority(D, D_sft):
    """Return q / P_k (paper 3.3): 1 in contact, Gaussian within the safety distance, 0 beyond."""
    gauss = ca.exp(-2 * ca.fmax(D, 0) ** 2 / D_sft**2)
    return ca.if_else(D_sft >= D, gauss, 0)


def step_priority(D, D_sft):
    """Return q / P_k of the baseline: 1 within the safety distance, 2 in contact, 0 beyond.

    Brown & Gerdes' published code doubles the cost of an intrusion at contact; the step is blended
    there by a tanh of `STEP_BLEND`. P_k is the weight before contact.
    """
    doubled = (3 - ca.tanh(D / STEP_BLEND)) / 2
    return ca.if_else(D_sft >= D, doubled, 0)


def intrusion(D, D_sft, priority=gaussian_priority):
    """Return the squared error of a distance times q / P_k [m^2] (paper, section 3.3)."""
    return priority(D, D_sft) * (D - D_sft) ** 2


# by the value of the parameter formulation.priority
PRIORITIES = {'gaussian': gaussian_priority, 'step': step_priority}


def periodic_square(angle):
    """Return about angle^2 [rad^2], equal for whole turns more or less.

    2 (1 - cos) is the square to 1 % at 20 deg. The heading of the path counts on over laps, that
    of the car may not.
    """
    return 2 * (1 - ca.cos(angle))


def intrusions(distances, D_sft, priority):
    """Return the sum of the squared errors of distances within D_sft (paper, section 3.3)."""
    return sum(intrusion(D, D_sft, priority) for circles in distances for D in circles)


def excess(value, limit):
    """Return how far |value| is beyond a limit, 0 within it."""
    return ca.fmax(ca.fabs(value) - limit, 0)


def _front_slip_excess(q: StageQuantities):
    # the last stage has no rate, and so no lag, of the steering
    x = q.x if q.u is None else single_track.acting(q.x, q.u, q.p.car)
    alpha = ca.atan(single_track.slips(x, q.p.car).f)
    return excess(alpha, q.p.envelope.front_slip * single_track.sliding_slips(q.p.car).f)


def _time_gap_lack(q: StageQuantities):
    needed, lacks = q.p.envelope.time_gap_s * q.x.vx, []
    for lead in q.p.leads:
        inside = (lead.reach - ca.fabs(q.tracking.con - lead.e)) / STRIP_BLEND_M
        lacks.append(ca.fmax(q.x.theta + needed - lead.theta, 0) * ca.fmin(ca.fmax(inside, 0), 1))
    return sum(lack**2 for lack in lacks)


def _soft_limit(name, parameter, excess_of):
    """Return the term of an excess over the share `name` of `parameters.Envelope`."""
    return CostTerm(name, parameter, lambda q: excess_of(q) ** 2, optional=True, limit=name)


VELOCITY = CostTerm('vel', 'tolerances.velocity_mps', lambda q: (q.x.vx - q.p.v_ref) ** 2)
DISTANCES = (
    CostTerm('v2o', 'priorities.obstacle', lambda q: intrusions(q.v2o, q.p.D_sft.o, q.priority)),
    CostTerm('v2e', 'priorities.edge', lambda q: intrusions(q.v2e, q.p.D_sft.e, q.priority)),
)
# Soft limits of stable handling: Bobier-Tiu & Gerdes, "Staying within the nullcline boundary for
# vehicle envelope control using a sliding surface", VSD 2013; Brown, Funke, Erlien & Gerdes, "Safe
# driving envelopes for path tracking in autonomous vehicles", CEP 2017
ENVELOPE = (
    _soft_limit('front_slip', 'tolerances.front_slip_excess_rad', _front_slip_excess),
    _soft_limit(
        'rear_slip',
        'tolerances.rear_slip_excess_rad',
        lambda q: excess(
            ca.atan(single_track.slips(q.x, q.p.car).r),
            q.p.envelope.rear_slip * single_track.sliding_slips(q.p.car).r,
        ),
    ),
    _soft_limit(
        'yaw_rate',
        'tolerances.yaw_rate_excess_radps',
        lambda q: excess(
            q.x.r, q.p.envelope.yaw_rate * single_track.greatest_yaw_rate(q.x, q.p.car)
        ),
    ),
)
# the gap to who is ahead grows with the speed: ISO 15622, time gap
TIME_GAP = CostTerm(
    'time_gap',
    'tolerances.time_gap_lack_m',
    _time_gap_lack,
    optional=True,
    limit='time_gap_s',
)
# of every formulation: inputs, jerk, and a car that is too slow
COMMON = (
    CostTerm('d_delta', 'tolerances.steer_rate_radps', lambda q: q.u.d_delta**2, uses_input=True),
    CostTerm('d_Fx', 'tolerances.force_rate_nps', lambda q: q.u.d_Fx**2, uses_input=True),
    CostTerm(
        'lambda_b',
        'tolerances.brake_split',
        lambda q: (q.u.lambda_b - single_track.ideal_split(q.x.Fx, q.p.car)) ** 2,
        uses_input=True,
        absent_with=('brake_split', FIXED),
    ),
    CostTerm('slack', 'tolerances.slack_m', lambda q: q.u.slack**2, uses_input=True),
    # what a slack of its own would cost: with that of the road, a slow car might leave it for free
    CostTerm('slow', 'tolerances.slack_m', lambda q: ca.fmax(q.p.least_speed - q.x.vx, 0) ** 2),
    CostTerm(
        'jerk',
        'tolerances.lateral_jerk_mps3',
        lambda q: single_track.lateral_jerk(q.x, q.u, q.p.car) ** 2,
        uses_input=True,
        optional=True,
    ),
)
# the paper's MPCC, with the heading error of the baseline as a switch
MPCC = (
    CostTerm('con', 'tolerances.contouring_m', lambda q: q.tracking.con**2),
    CostTerm('lag', 'tolerances.lag_m', lambda q: q.tracking.lag**2, switch='lag'),
    VELOCITY,
    CostTerm(
        'dpsi',
        'tolerances.heading_rad',
        lambda q: periodic_square(q.heading_error),
        switch='heading',
        optional=True,
    ),
    *DISTANCES,
    *ENVELOPE,
    TIME_GAP,
    *COMMON,
)
# the baseline, in path coordinates
FRENET = (
    CostTerm('e', 'tolerances.contouring_m', lambda q: q.tracking.e**2),
    CostTerm('dpsi', 'tolerances.heading_rad', lambda q: q.heading_error**2, switch='heading'),
    VELOCITY,
    *DISTANCES,
    *ENVELOPE,
    *COMMON,
)

# what is kept away from as long as it can be
SOFT_LIMITS = (*(term.name for term in (*DISTANCES, *ENVELOPE, TIME_GAP)), 'slack', 'slow')

# the weights that are tuned in every formulation
TUNED = (
    'tolerances.contouring_m',
    'tolerances.velocity_mps',
    'tolerances.steer_rate_radps',
    'tolerances.force_rate_nps',
    'priorities.obstacle',
    'priorities.edge',
)


def in_use(terms: Sequence[CostTerm], params: ControllerParams) -> tuple[CostTerm, ...]:
    """Return the terms of the problem: their parameter is given, optional ones are on.

    A fixed brake split has no cost: it could only change the force. Raises CostTermError for terms
    that contradict each other or the parameters, and for a parameter that no term uses.
    """
    _check_list(terms, params)

    def is_in_use(term):
        off = term.optional and not is_on(term, params)
        if term.absent_with:
            name, value = term.absent_with
            off = off or getattr(params.formulation, name) == value
        return not off and _parameter(term, params) is not None

    return tuple(term for term in terms if is_in_use(term))


def _check_list(terms: Sequence[CostTerm], params: ControllerParams) -> None:
    """Raise CostTermError for what is wrong with terms of a formulation and their weights.

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
        if term.parameter.startswith(PRIORITY):
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
                f'{params.formulation.name} uses it: put its CostTerm into COMMON, MPCC or FRENET '
                'of problem/cost_terms.py, or leave the parameter out'
            )


def weights(terms: Sequence[CostTerm], params: ControllerParams | None = None):
    """Return the weights of terms that are `in_use`, a NamedTuple; without `params` their names."""
    names = [term.name for term in terms]
    values = [_weight(term, params) for term in terms] if params else names
    return namedtuple('Weights', names)(*values)


def limits(terms: Sequence[CostTerm], params: ControllerParams | None = None):
    """Return the limits of terms that are `in_use`, a NamedTuple; 1 where none is given.

    Without `params` the names, which are those in `parameters.Envelope`.
    """
    names = [term.limit for term in terms if term.limit]
    given = [getattr(params.envelope, name) for name in names] if params else names
    return namedtuple('Limits', names)(*(1.0 if share is None else share for share in given))


def squared_errors(terms: Sequence[CostTerm], quantities: StageQuantities) -> dict[str, Any]:
    """Return the squared errors by name; at the last stage (no input) those of the state only.

    Raises CostTermError for what is not one number.
    """
    errors = {}
    for term in terms:
        if quantities.u is None and term.uses_input:
            continue
        try:
            errors[term.name] = error = term.squared_error(quantities)
        except Exception as fault:
            raise CostTermError(f'{term.title}: {_explain(fault, quantities)}') from fault
        if isinstance(error, ca.SX | ca.MX | ca.DM):
            size = f'{error.size1()} x {error.size2()} numbers' if error.numel() != 1 else ''
        else:
            is_number = np.asarray(error).dtype.kind in 'fiu' and not isinstance(
                error, list | tuple
            )
            size = '' if is_number else f'of type {type(error).__name__}'
        if size:
            raise CostTermError(
                f'{term.title}: its squared error is {size}; it must be one number: '
                'add the squares of several errors'
            )
    return errors


def costs(errors: dict[str, Any], weights) -> dict[str, Any]:
    """Return the cost by name of the term."""
    return {name: getattr(weights, name) * error for name, error in errors.items()}


def _parameter(term, params):
    group, name = term.parameter.split('.')
    return getattr(getattr(params, group), name)


def is_on(term: CostTerm, params: ControllerParams) -> bool:
    """Return whether the switch of a term, if it has one, is on."""
    return not term.switch or getattr(params.formulation, term.switch)


def _weight(term, params):
    if not is_on(term, params):
        return 0.0
    value = _parameter(term, params)
    return value if term.parameter.startswith(PRIORITY) else value**-2


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
