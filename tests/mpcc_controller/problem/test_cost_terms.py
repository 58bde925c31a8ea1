"""Exchangeable terms of the cost: what each changes, and what it leaves unchanged."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bags.figures import frame_distances
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Input, State
from mpcc_controller.problem import cost_terms
from msgs_yaml.types import Obstacle, Obstacles, RoadEdges

START = State(50.0, 0.5, 0.05, 20.0, 0.0, 0.0, 50.0, 0.0, 0.0)
D_SFT = 0.5
EXPECTED = {
    'gaussian': lambda D: 1.0 if D < 0 else np.exp(-2 * (D / D_SFT) ** 2),
    'step': lambda D: 1.5 - np.tanh(50 * D) / 2,
}


@pytest.mark.parametrize('kind', cost_terms.PRIORITIES)
def test_the_cost_of_a_distance_is_its_closed_form_and_its_slope_has_no_jump(kind):
    symbol = ca.SX.sym('D')
    intrusion = cost_terms.intrusion(symbol, D_SFT, cost_terms.PRIORITIES[kind])
    curve = ca.Function('curve', [symbol], [intrusion, ca.gradient(intrusion, symbol)])

    def expected(D):
        return EXPECTED[kind](D) * (D - D_SFT) ** 2 if D <= D_SFT else 0.0

    @given(st.floats(-2.0, 3.0) | st.sampled_from([0.0, D_SFT, 1e4]))
    def check(D):
        cost, slope = map(float, curve(D))
        assert cost == pytest.approx(expected(D), rel=1e-9, abs=1e-12)
        h = 1e-6
        difference = (expected(D + h) - expected(D - h)) / (2 * h)
        assert slope == pytest.approx(difference, rel=1e-4, abs=1e-4)
        assert slope <= 0.0  # nearer never costs less
        assert D < 1e4 or (cost, slope) == (0.0, 0.0)

    check()


def on_circle(s, radius, inside=0.0):
    return (radius - inside) * np.sin(s / radius), radius - (radius - inside) * np.cos(s / radius)


def values(pose, controller='mpcc', scene=None, **changes):
    """Return the values of a plan along the path from a state beside it, under other rules."""
    options = {f'formulation__{name}': value for name, value in changes.items()}
    options |= {'scene': scene} if scene else {}
    return pose(START, controller, drives=True, **options).values()


def assert_equal_costs(one, other, but):
    for name in set(one.costs._fields) - but:
        assert np.array_equal(getattr(one.costs, name), getattr(other.costs, name)), name


def test_without_the_lag_error_only_its_cost_is_gone(pose):
    paper, without = (values(pose, lag=on) for on in (True, False))
    assert paper.costs.lag.sum() > 0 == without.costs.lag.sum()
    assert without.tracking.lag == pytest.approx(paper.tracking.lag)
    assert_equal_costs(paper, without, but={'lag'})


def test_the_heading_error_is_a_term_of_its_own_that_costs_what_it_costs_the_baseline(pose):
    paper, headed = (values(pose, heading=on) for on in (False, True))
    assert set(headed.costs._fields) - set(paper.costs._fields) == {'dpsi'}
    assert_equal_costs(paper, headed, but=set())
    baseline, without = (values(pose, 'frenet', heading=on) for on in (True, False))
    assert_equal_costs(baseline, without, but={'dpsi'})
    assert headed.costs.dpsi.sum() > 0 == without.costs.dpsi.sum()
    # the first point is beside the path: the baseline projects it again, the MPCC uses theta
    assert headed.costs.dpsi[1:] == pytest.approx(baseline.costs.dpsi[1:], rel=2e-3, abs=1e-6)


def test_whole_turns_are_no_heading_error(pose):
    posed = pose(START, drives=True, formulation__heading=True)
    turned = posed.plan._replace(X=posed.plan.X - State(0, 0, 2 * np.pi, 0, 0, 0, 0, 0, 0))
    once, again = (posed.values(plan).costs.dpsi for plan in (posed.plan, turned))
    assert again == pytest.approx(once, rel=1e-9, abs=1e-12)


def test_the_measure_of_distances_counts_only_beside_a_bend_and_only_for_distances(pose, roads):
    ground, path = (values(pose, distance=where) for where in ('cartesian', 'path'))
    assert 0.05 < np.abs(ground.v2o[0] - path.v2o[0]).max() < 1.0
    # across the path an edge is at most 1 / cos(heading) farther than where it is nearest
    assert np.all(path.v2e[0] > ground.v2e[0] - 1e-3)
    assert_equal_costs(ground, path, but={'v2o', 'v2e'})
    ground, path = (
        values(pose, scene=roads['straight'], distance=kind) for kind in ('cartesian', 'path')
    )
    for mine, other in zip(ground.v2o[:1] + ground.v2e, path.v2o[:1] + path.v2e):
        assert mine == pytest.approx(other, abs=1e-6)


def test_a_step_of_the_priority_changes_only_costs_of_distances(pose):
    gaussian, step = (values(pose, priority=kind) for kind in ('gaussian', 'step'))
    assert_equal_costs(gaussian, step, but={'v2o', 'v2e'})
    assert np.all(step.costs.v2o >= gaussian.costs.v2o)
    assert step.costs.v2o.sum() > 1.05 * gaussian.costs.v2o.sum() > 0.0


@pytest.mark.parametrize('inside', [1.0, -1.0])
@pytest.mark.parametrize(
    ('controller', 'rules', 'frame'),
    [('mpcc', {}, 'cartesian'), ('frenet', {}, 'frenet'), ('mpcc', {'distance': 'path'}, 'frenet')],
)
def test_each_frame_has_its_own_distance_to_an_obstacle_beside_a_bend(
    pose, world, controller, rules, frame, inside
):
    """The closed forms are those of the judge, which shares no code with the controllers."""
    radius, s, still = 20.0, np.linspace(10.0, 60.0, 51), np.zeros(51)
    line = world.path(*on_circle(np.arange(0.0, 120.0, 0.5), radius), 9.0)
    left, right = (np.column_stack(on_circle(np.arange(120.0), radius, e)) for e in (6.0, -6.0))
    obstacle = Obstacle(1, *on_circle(45.0, radius, inside), 1.0, 0.0, 0.0)
    road = line, RoadEdges(0, left, right), Obstacles(0, (obstacle,))
    scene = world.scene(type(world.straight())(*road))
    x = State(*on_circle(s, radius), s / radius, still + 9.0, still, still, s, still, still)
    posed = pose(START, controller, scene, **{f'formulation__{k}': v for k, v in rules.items()})
    plan = posed.form.to_local(posed.plan._replace(X=np.column_stack(x)), scene.path)
    numbers = posed.form.stage_parameters(scene, np.column_stack(x))
    closed = frame_distances.circle_distances(radius, 45.0 - s, inside, 2.1)
    seen = posed._replace(plan=plan, numbers=numbers).values().v2o[0]
    assert seen == pytest.approx(getattr(closed, frame), abs=5e-3)


ENVELOPE = {
    'front_slip': 'front_slip_excess_rad',
    'rear_slip': 'rear_slip_excess_rad',
    'yaw_rate': 'yaw_rate_excess_radps',
}


OPTIONAL = [term for term in cost_terms.MPCC if term.optional and not term.switch]
LIMITS = {**{name: name for name in ENVELOPE}, 'time_gap': 'time_gap_s', 'jerk': ''}


@pytest.mark.parametrize('term', OPTIONAL, ids=lambda term: term.name)
def test_an_optional_term_is_in_the_problem_where_its_tolerance_is(pose, term):
    tolerance = {term.parameter.replace('.', '__'): 0.01}
    paper, more = (pose(START, **changes).form.ocp for changes in ({}, tolerance))
    assert {t.name for t in more.terms} - {t.name for t in paper.terms} == {term.name}
    assert paper.template.envelope == ()
    limits = (term.limit,) if term.limit else ()
    assert LIMITS.items() <= {t.name: t.limit for t in OPTIONAL}.items()
    assert more.template.envelope._fields == limits


@pytest.fixture(scope='module')
def limited(pose):
    """Return a problem with all soft limits."""
    return pose(START, **{f'tolerances__{name}': 0.01 for name in ENVELOPE.values()})


@settings(max_examples=40)
@given(
    st.floats(8, 40),
    st.floats(-10, 10),
    st.floats(-1.5, 1.5),
    st.floats(-0.45, 0.45),
    st.floats(0.3, 1.5),
)
def test_a_soft_limit_costs_the_square_of_what_is_beyond_it(limited, vx, vy, r, delta, share):
    car = limited.form.car
    g, wheelbase = 9.81, car.l_f + car.l_r
    front_load, rear_load = (car.m * g * arm / wheelbase for arm in (car.l_r, car.l_f))
    front = abs(np.arctan2(vy + car.l_f * r, vx) - delta)
    rear = abs(np.arctan2(vy - car.l_r * r, vx))
    grip = (car.mu_f * front_load + car.mu_r * rear_load) / car.m
    expected = {
        'front_slip': front - share * np.arctan(3 * car.mu_f * front_load / car.C_f),
        'rear_slip': rear - share * np.arctan(3 * car.mu_r * rear_load / car.C_r),
        'yaw_rate': abs(r) - share * grip / vx,
    }
    shares = type(limited.form.constants['envelope'])(share, share, share)
    x = State(50.0, 0.0, 0.0, vx, vy, r, 50.0, delta, 0.0)
    errors = limited.errors(None, x, envelope=shares)
    for name, beyond in expected.items():
        # the controller rounds the speed at its least value: 1 % at 8 m/s
        assert np.sqrt(errors[name]) == pytest.approx(max(beyond, 0.0), rel=0.02, abs=5e-3), name


def test_the_lateral_jerk_costs_its_square(pose):
    posed, u = pose(START, tolerances__lateral_jerk_mps3=1.0), Input(-0.3, 0.0, 0.6, 0.0)
    jerk = float(single_track.lateral_jerk(START, u, posed.form.car))
    assert posed.errors(u, START)['jerk'] == pytest.approx(jerk**2)
    assert jerk < -1.0


def test_the_front_slip_that_counts_is_that_of_the_angle_that_acts(pose, limited):
    """The tyre has the slip of the lagging angle; the set-point runs ahead of it."""
    posed = pose(START, tolerances__front_slip_excess_rad=0.01, model__servo_lag=True)
    lag = posed.form.car.steer_lag

    def excess(delta, *inputs):
        x = State(50.0, 0.0, 0.0, 20.0, 0.0, 0.0, 50.0, delta, 0.0)
        u = Input(*inputs, 0.0, 0.6, 0.0) if inputs else None
        return np.sqrt(posed.errors(u, x)['front_slip'])

    assert excess(0.3, 0.0) > 0.1
    assert excess(0.3 + 0.5 * lag, 0.5) == pytest.approx(excess(0.3, 0.0), rel=1e-9)
    assert excess(0.3) == excess(0.3, 0.0)  # the last stage has no rate
