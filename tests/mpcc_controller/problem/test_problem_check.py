"""What is wrong in a cost term is told when a controller starts, with its name and what to do."""

import casadi as ca
import pytest

from mpcc_controller.driving.prediction_model import PredictionModel
from mpcc_controller.problem import cost_terms
from mpcc_controller.problem.cost_terms import CostTerm, CostTermError
from mpcc_controller.problem.mpcc_formulation import MpccFormulation

JERK = 'tolerances.lateral_jerk_mps3'  # a parameter that may be left out
OWN = rf"^cost term 'own' \({JERK}\): "


@pytest.fixture
def start(world, monkeypatch):
    """Return start(*terms): a controller starts with own terms of the paper's MPCC."""

    def start(*terms, **parameters):
        kept = tuple(term for term in cost_terms.MPCC if term.name != 'jerk')
        monkeypatch.setattr(MpccFormulation, 'terms', (*kept, *terms))
        changes = {JERK: 1.0} | parameters
        return PredictionModel(
            *world.load('mpcc', **{n.replace('.', '__'): v for n, v in changes.items()})
        )

    return start


def fail(q):
    raise NotImplementedError


def own(squared_error, name='own', parameter=JERK, **options):
    return CostTerm(name, parameter, squared_error, optional=True, **options)


def yaw(q):
    return q.x.r**2


def test_a_term_that_is_right_is_accepted(start):
    terms = own(yaw), own(lambda q: (q.u.d_delta - q.x.r) ** 2, 'second', uses_input=True)
    root = own(lambda q: ca.sqrt(q.x.r**2 + 1e-4), 'root')
    names = [term.name for term in start(*terms, root).formulation.ocp.terms]
    assert names[-3:] == ['own', 'second', 'root']


@pytest.mark.parametrize(
    ('squared_error', 'message'),
    [
        # what no solver can use, with the state
        (lambda q: ca.sqrt(q.x.r), 'its value is -?nan at r = -1.5'),
        (lambda q: ca.sqrt(ca.fabs(q.x.r)), 'its derivative by r is .* at r = 0; value, first'),
        (lambda q: ca.fabs(q.x.vy) ** 1.5, 'its second derivative by vy is .* at vy = 0'),
        (lambda q: 1 / q.x.delta**2, 'its value is inf at delta = 0'),
        (lambda q: ca.log(q.x.Fx) ** 2, 'its value is .* at Fx = '),
        (lambda q: q.x.vy / q.x.vx - 1.0, 'its value is -.* at vx = .*, vy = .* not be negative'),
        # what is not one number, with what to write
        (lambda q: q.u.d_delta**2, r'it uses the input \(q.u.d_delta\), .*; say uses_input=True'),
        (lambda q: q.x.yaw_rate**2, "there is no 'yaw_rate'; there are X, Y, psi, vx, vy, r, "),
        (lambda q: ca.vertcat(q.x.r, q.x.vy) ** 2, 'its squared error is 2 x 1 numbers; it must'),
        (lambda q: (q.x.r, q.x.vy), 'its squared error is of type tuple; it must be one number'),
        (lambda q: None, 'its squared error is of type NoneType'),
        (lambda q: q.x.r if q.x.r > 0 else 0, r'.*use ca\.if_else in place of if'),
        (lambda q: ca.sin(), r'\w+Error: '),
        (fail, 'NotImplementedError$'),  # an exception without a text
    ],
)
def test_a_squared_error_that_cannot_be_used_is_refused(start, squared_error, message):
    with pytest.raises(CostTermError, match=OWN + message):
        start(own(squared_error))


@pytest.mark.parametrize(
    ('terms', 'parameters', 'message'),
    [
        ([own(yaw, name='con')], {}, "'con' .*tolerances.contouring_m.* has the"),
        ([own(yaw, name='yaw rate')], {}, 'its name must be a Python identifier'),
        ([own(yaw, name='_yaw')], {}, 'its name must be a Python identifier'),
        ([own(yaw, name='if')], {}, 'its name must be a Python identifier'),
        ([own(yaw, parameter='tolerances.jerk')], {}, 'there is no such parameter'),
        ([own(yaw, switch='on')], {}, "there is no parameter 'formulation.on'"),
        ([own(yaw, limit='on')], {}, "there is no parameter 'envelope.on'"),
        ([own(yaw)], {JERK: 0.0}, 'its tolerance is 0; allowed above 0'),
        ([own(yaw)], {JERK: -1.0}, 'its tolerance is -1; allowed above 0'),
        ([own(yaw)], {'priorities.obstacle': -2.0}, 'its weight is -2; allowed from 0'),
        ([], {}, rf'^{JERK}: is 1, but no cost term .* mpcc uses it'),
    ],
)
def test_terms_that_contradict_each_other_or_the_parameters_are_refused(
    start, monkeypatch, terms, parameters, message
):
    # a range of the reader's own may allow a value; those of the shipped parameters do not
    monkeypatch.setattr('node_runtime.parameters.Range.fault', lambda *_: '')
    with pytest.raises(CostTermError, match=message):
        start(*terms, **parameters)
