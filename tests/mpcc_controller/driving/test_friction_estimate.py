"""The friction of the road follows from the motion: where tyres are used, and only there."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.delay_compensation import (
    SetpointRamp,
    constant_ramp,
    setpoints_at,
)
from mpcc_controller.driving.friction_estimate import FrictionEstimator
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import FrictionEstimate
from mpcc_controller.problem import stage_parameters
from msgs_yaml.types import Command, VehicleState
from node_runtime import parameters
from node_runtime.parameters import ParameterError

TICK_NS = 50_000_000
# the car of these tests, integrated finely by another method, follows its set-points without lag
RULES = FrictionEstimate(
    on=True,
    lowest=0.3,
    quantile=0.2,
    spread=0.05,
    doubt=0.1,
    memory_s=3.0,
    speed_noise_mps=0.05,
    lateral_noise_mps=0.03,
    yaw_rate_noise_radps=0.015,
    sideslip_error_rad=0.01,
    actuator_delay_s=0.0,
)


@pytest.fixture(scope='module')
def nominal(world):
    """Return the car on the road of friction 1."""
    return stage_parameters.car(*world.load())


@pytest.fixture(scope='module')
def estimator_(nominal):
    """Return a function that returns an estimate at its start; it is built once."""
    shared = FrictionEstimator(RULES, nominal, 1.0)
    return lambda: Estimate(shared)


class Estimate:
    """An estimator with what it has learnt."""

    def __init__(self, estimator):
        self.estimator, self.memory = estimator, estimator.start

    def update(self, x, ramps):
        self.memory = self.estimator.update(self.memory, x, ramps)
        return self.belief

    def filtered(self, x):
        return self.estimator.filtered(self.memory, x)

    @property
    def belief(self):
        return self.estimator.belief(self.memory)


def drive(world, car, friction, targets, speed=20.0):
    """Yield states of the model on a road of a friction, and the ramps sent before each."""
    slippery = car._replace(mu_f=friction * car.mu_f, mu_r=friction * car.mu_r)
    advance = world.make_car(slippery)
    x = State(0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0, 0.0, 0.0)
    ramps = [constant_ramp(Setpoints(0.0, 0.0), 0.6)]
    for k, target in enumerate(targets):
        now_ns = k * TICK_NS
        yield VehicleState(now_ns, *x[:6]), ramps
        ramps = [*ramps, SetpointRamp(now_ns, ramps[-1].end, now_ns + TICK_NS, target, 0.6)]
        x = advance(x, Command(now_ns, target.delta, 0.0, 0.6 * target.Fx, 0.4 * target.Fx))


def estimates(estimator, states):
    return [estimator.update(x, ramps) for x, ramps in states]


def swerve(ticks=40, amplitude=0.1):
    return [Setpoints(amplitude * np.sin(2 * np.pi * k / 30), 0.0) for k in range(ticks)]


def braking(ticks=30, force=-12e3):
    return [Setpoints(0.0, max(force, -2e3 * k)) for k in range(ticks)]


@settings(max_examples=15)
@given(friction=st.floats(0.4, 0.95), speed=st.floats(18.0, 30.0))
def test_a_swerve_at_the_limit_tells_the_friction(world, nominal, estimator_, friction, speed):
    beliefs = estimates(estimator_(), drive(world, nominal, friction, swerve(), speed))
    assert friction - 0.1 < beliefs[-1].friction <= friction + 0.06
    assert max(belief.excitation for belief in beliefs) > 1.0


@pytest.mark.parametrize('friction', [0.4, 0.55])
def test_braking_beyond_the_friction_tells_it(world, nominal, estimator_, friction):
    beliefs = estimates(estimator_(), drive(world, nominal, friction, braking()))
    assert beliefs[-1].friction == pytest.approx(friction, abs=0.1)


def test_the_friction_is_found_within_half_a_second(world, nominal, estimator_):
    states = drive(world, nominal, 0.6, swerve(), 25.0)
    beliefs = [belief.friction for belief in estimates(estimator_(), states)]
    below = next(k for k, friction in enumerate(beliefs) if friction < 0.7)
    assert below * 0.05 <= 0.5


def test_the_friction_of_the_scenario_is_believed_where_it_is_true(world, nominal, estimator_):
    beliefs = estimates(estimator_(), drive(world, nominal, 1.0, swerve(), 25.0))
    assert min(belief.friction for belief in beliefs) > 0.85


def test_straight_on_nothing_is_learnt(world, nominal, estimator_):
    estimator = estimator_()
    before = estimator.belief.friction
    beliefs = estimates(estimator, drive(world, nominal, 0.5, [Setpoints(0.0, 0.0)] * 40))
    assert [belief.friction for belief in beliefs] == pytest.approx([before] * 40, abs=1e-3)
    assert max(belief.excitation for belief in beliefs) < 0.1


def test_what_was_learnt_fades_as_slowly_as_configured(world, nominal, estimator_):
    estimator = estimator_()
    start = estimator.belief.friction
    targets = swerve() + [Setpoints(0.0, 0.0)] * 300
    beliefs = estimates(estimator, drive(world, nominal, 0.6, targets))
    found = [belief.friction for belief in beliefs]
    assert found[60] < 0.7
    assert start - 0.05 < found[-1] <= start + 1e-9


def test_it_starts_again_after_a_reset(world, nominal, estimator_):
    states = list(drive(world, nominal, 0.6, swerve()))
    first = estimates(estimator_(), states)
    assert estimates(estimator_(), states) == first


def test_a_gap_between_states_is_no_measurement(world, nominal, estimator_):
    estimator = estimator_()
    states = list(drive(world, nominal, 0.5, swerve(60)))
    for x, ramps in states[::4]:
        assert estimator.update(x, ramps).excitation == 0.0
    assert estimator.belief.friction == pytest.approx(estimator_().belief.friction)


NOISE = np.array([0.1, 0.08, 0.01])  # m/s, m/s, rad/s


def noisy(states, factor, seed):
    """Yield states with white noise of the velocities."""
    rng = np.random.default_rng(seed)
    for x, ramps in states:
        vx, vy, r = factor * NOISE * rng.standard_normal(3)
        yield x._replace(vx=x.vx + vx, vy=x.vy + vy, r=x.r + r), ramps


@pytest.mark.parametrize('factor', [1.0, 2.0])
@pytest.mark.parametrize('targets', [[Setpoints(0.0, 0.0)] * 120, braking(60, -8e3)])
def test_noise_is_measured_and_not_taken_for_ice(world, nominal, estimator_, factor, targets):
    for seed in range(4):
        estimator = estimator_()
        states = noisy(drive(world, nominal, 1.0, targets), factor, seed)
        beliefs = [belief.friction for belief in estimates(estimator, states)]
        assert np.mean(np.array(beliefs) < 0.6) < 0.05
        assert beliefs[-1] > 0.75
        measured = np.sqrt(estimator.memory.noise)
        assert np.all(measured[:2] > 0.5 * factor * NOISE[:2])
        assert np.all(measured < 2.0 * factor * NOISE + 0.01)


@settings(max_examples=6, deadline=None)
@given(friction=st.floats(0.4, 0.9), seed=st.integers(0, 9))
def test_a_swerve_tells_the_friction_through_noise(world, nominal, estimator_, friction, seed):
    targets = [Setpoints(0.0, 0.0)] * 40 + swerve(80)
    beliefs = estimates(estimator_(), noisy(drive(world, nominal, friction, targets), 1.0, seed))
    assert abs(beliefs[-1].friction - friction) < 0.25


def test_filtered_velocities_are_nearer_to_the_truth(world, nominal, estimator_):
    estimator = estimator_()
    states, errors = list(drive(world, nominal, 1.0, swerve(120, 0.05))), []
    for (x, _), (measured, ramps) in zip(states, noisy(states, 1.0, 3)):
        estimator.update(measured, ramps)
        filtered = estimator.filtered(measured)
        assert filtered[:4] == measured[:4]
        errors.append([np.subtract(y[4:], x[4:]) for y in (measured, filtered)])
    before, after = np.std(np.array(errors)[40:], axis=0)
    assert np.all(after < before)
    assert np.all(after[:2] < 0.8 * before[:2])


def test_without_noise_the_state_stays_as_it_is(world, nominal, estimator_):
    estimator = estimator_()
    for x, ramps in drive(world, nominal, 1.0, swerve(60, 0.05)):
        estimator.update(x, ramps)
        np.testing.assert_allclose(estimator.filtered(x), x, atol=0.01)


FIELDS = st.floats(-1e3, 1e3) | st.sampled_from([np.nan, np.inf, 0.0])


@settings(max_examples=50)
@given(rows=st.lists(st.tuples(*[FIELDS] * 6), min_size=2, max_size=4), delta=st.floats(-0.5, 0.5))
def test_no_state_makes_the_belief_leave_its_range(nominal, estimator_, rows, delta):
    estimator = estimator_()
    ramps = [constant_ramp(Setpoints(delta, -5e3), 0.6)]
    for k, row in enumerate(rows):
        belief = estimator.update(VehicleState(k * TICK_NS, *row), ramps)
        assert RULES.lowest <= belief.friction <= 1.0
        assert np.isfinite(belief.excitation)


def test_one_wild_state_does_not_decide(world, nominal, estimator_):
    estimator = estimator_()
    for k, (x, ramps) in enumerate(drive(world, nominal, 1.0, swerve(amplitude=0.02))):
        if k == 20:
            x = x._replace(vy=x.vy + 3.0, r=x.r - 2.0)
        belief = estimator.update(x, ramps)
        assert belief.friction > 0.8


@pytest.fixture(scope='module')
def estimating(world):
    """Return a controller that estimates, for a car without lag."""
    params, vehicle = world.load(
        **{f'friction_estimate__{name}': value for name, value in vars(RULES).items()}
    )
    return Controller(params, vehicle)


def test_plans_bounds_and_brakes_take_the_believed_friction(world, estimating, nominal):
    world.set_inputs(estimating, world.lane_change())
    for x, ramps in drive(world, nominal, 0.5, swerve()):
        estimating.memory = replace(estimating.memory, ramps=tuple(ramps))
        _, _, why = world.tick(estimating, x)
    believed = why.values['friction.estimate']
    assert 0.4 < believed < 0.6
    assert estimating.car.mu_f == pytest.approx(believed * nominal.mu_f)
    problem = estimating.memory.solved.problem
    assert problem.parameters.stages.car == estimating.car
    names = estimating.parts.model.problem.parameters
    assert np.all(problem.parameters.P[:, names.index('car.mu_r')] == estimating.car.mu_r)
    # the last line of defence keeps to what the road may at most have
    assert estimating.parts.gate.car == nominal


@pytest.mark.parametrize(('believed', 'braked_with'), [(0.4, 0.46), (0.8, 0.92), (0.95, 1.0)])
def test_braking_without_a_plan_probes_a_little_beyond_the_belief(
    estimating, nominal, believed, braked_with
):
    car = estimating.parts.model.car_to_brake(believed)
    assert (car.mu_f, car.mu_r) == pytest.approx(
        (braked_with * nominal.mu_f, braked_with * nominal.mu_r)
    )


def test_after_a_restart_the_friction_of_the_parameters_is_believed(world, estimating, nominal):
    beliefs = []
    for _ in range(2):
        world.set_inputs(estimating, world.straight())
        states = drive(world, nominal, 0.6, swerve())
        whys = [world.tick(estimating, x)[2] for x, _ in states]
        beliefs.append([why.values['friction.estimate'] for why in whys])
    assert beliefs[0] == beliefs[1]
    assert beliefs[0][0] > 0.85


def test_without_the_switch_nothing_is_estimated(world, controller):
    *_, why = world.tick(controller, world.rolling(stamp_ns=1))
    assert not {'friction.estimate', 'friction.excitation'} & why.values.keys()


def test_a_group_that_is_on_must_be_complete(world):
    params, _ = world.load(friction_estimate__on=True)
    with pytest.raises(ParameterError, match=r'friction_estimate\.lowest: is missing'):
        parameters.build(type(params), parameters.flatten(params), 'my.yaml')


def test_ramps_hold_until_the_next_one_begins(world):
    ramps = [
        constant_ramp(Setpoints(0.1, 0.0), 0.6),
        SetpointRamp(100, Setpoints(0.1, 0.0), 200, Setpoints(0.2, -100.0), 0.7),
        SetpointRamp(300, Setpoints(0.2, -100.0), 400, Setpoints(0.0, 0.0), 0.8),
    ]
    seen = [setpoints_at(ramps, ns) for ns in (50, 150, 250, 350)]
    assert [split for _, split in seen] == [0.6, 0.7, 0.7, 0.8]
    assert [s.delta for s, _ in seen] == pytest.approx([0.1, 0.15, 0.2, 0.1])
    assert all(a.delta != b.delta for (a, _), (b, _) in pairwise(seen))


def test_what_a_hypothesis_cannot_explain_tells_it_nothing_of_the_sideslip_error(
    nominal, estimator_, world
):
    """Wild states: each is rejected by every hypothesis, and none gets surer of its error."""
    estimator, ramps = estimator_(), [constant_ramp(Setpoints(0.0, 0.0), 0.6)]
    for k in range(12):  # the noise becomes known
        estimator.update(world.rolling(v=20.0, vy=0.1 * (-1) ** k, stamp_ns=k * TICK_NS), ramps)
    before = estimator.memory.variance  # of the sideslip error, by hypothesis
    for k in range(12, 14):
        x = world.rolling(v=20.0, vy=4.0 * (-1) ** k, stamp_ns=k * TICK_NS)
        estimator.update(x, ramps)
    assert np.all(estimator.memory.variance >= before)
    assert np.all(estimator.memory.variance < 1.01**2 * before)
    for k in range(14, 80):  # straight on the error becomes known
        estimator.update(world.rolling(v=20.0, stamp_ns=k * TICK_NS), ramps)
    assert np.all(estimator.memory.variance < 0.8**2 * before)
