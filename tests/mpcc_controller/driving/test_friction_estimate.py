"""The friction of the road follows from the motion: where tyres are used, and only there."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.delay_compensation import SetpointRamp, constant_ramp
from mpcc_controller.driving.friction_estimate import FrictionEstimator
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import FrictionEstimate
from mpcc_controller.problem import stage_parameters
from msgs_yaml.types import Command, VehicleState

TICK_NS = 50_000_000
STRAIGHT = Setpoints(0.0, 0.0)
NO_LAGS = (0.0, 0.0)  # s, of steering and forces
NOISE = np.array([0.1, 0.08, 0.01])  # m/s, m/s, rad/s


@pytest.fixture(scope='module')
def rules(world):
    """Return the parameters of an estimate for a car that follows its set-points without lag."""
    values = {name.partition('__')[2]: value for name, value in world.ESTIMATE.items()}
    return FrictionEstimate(**values)


@pytest.fixture(scope='module')
def nominal(world):
    """Return the car on the road of friction 1."""
    return stage_parameters.car(*world.load())


@pytest.fixture(scope='module')
def estimator_(nominal, rules):
    """Return a function that returns an estimate at its start; it is built once."""
    shared = FrictionEstimator(rules, nominal, NO_LAGS, 1.0)
    return lambda: Estimate(shared)


class Estimate:
    """An estimator with what it has learnt."""

    def __init__(self, estimator):
        self.estimator, self.memory = estimator, estimator.start

    def update(self, x, ramps):
        self.memory = self.estimator.update(self.memory, x, ramps)
        return self.belief

    def frictions(self, states):
        """Return what is believed after each state."""
        return np.array([self.update(x, ramps).friction for x, ramps in states])

    def filtered(self, x):
        return self.estimator.filtered(self.memory, x)

    @property
    def belief(self):
        return self.estimator.belief(self.memory)


@pytest.fixture(scope='module')
def drive(world, nominal):
    """Return a function that returns states on a road of a friction, and the ramps before each."""

    def states(friction, targets, speed=20.0, factor=0.0, seed=0):
        """`factor` times NOISE is added to the velocities."""
        slippery = nominal._replace(mu_f=friction * nominal.mu_f, mu_r=friction * nominal.mu_r)
        advance, rng = world.make_car(slippery), np.random.default_rng(seed)
        x = State(0.0, 0.0, 0.0, speed, 0.0, 0.0, 0.0, 0.0, 0.0)
        ramps, rows = [constant_ramp(STRAIGHT, 0.6)], []
        for k, target in enumerate(targets):
            now_ns = k * TICK_NS
            noise = factor * NOISE * rng.standard_normal(3)
            rows.append((VehicleState(now_ns, *x[:3], *(x[3:6] + noise).tolist()), ramps))
            ramps = [*ramps, SetpointRamp(now_ns, ramps[-1].end, now_ns + TICK_NS, target, 0.6)]
            x = advance(x, Command(now_ns, target.delta, 0.0, 0.6 * target.Fx, 0.4 * target.Fx))
        return rows

    return states


def swerve(ticks=40, amplitude=0.1):
    return [Setpoints(amplitude * np.sin(2 * np.pi * k / 30), 0.0) for k in range(ticks)]


def braking(ticks=30, force=-12e3, rate=2e3):
    return [Setpoints(0.0, max(force, -rate * k)) for k in range(ticks)]


@settings(max_examples=8)
@given(friction=st.floats(0.4, 0.95), speed=st.floats(18.0, 30.0))
def test_a_swerve_at_the_limit_tells_the_friction(drive, estimator_, friction, speed):
    estimator = estimator_()
    beliefs = [estimator.update(x, ramps) for x, ramps in drive(friction, swerve(), speed)]
    assert friction - 0.1 < beliefs[-1].friction <= friction + 0.06
    assert max(belief.excitation for belief in beliefs) > 1.0


def test_straight_on_nothing_is_learnt_and_what_was_learnt_fades_as_slowly_as_configured(
    drive, estimator_
):
    estimator, start = estimator_(), estimator_().belief.friction
    for x, ramps in drive(0.5, [STRAIGHT] * 20):
        belief = estimator.update(x, ramps)
        assert belief.friction == pytest.approx(start, abs=1e-3)
        assert belief.excitation < 0.1
    frictions = estimator_().frictions(drive(0.6, swerve() + [STRAIGHT] * 300))
    assert frictions[60] < 0.7
    assert start - 0.05 < frictions[-1] <= start + 1e-9
    assert frictions[100] < frictions[-1]


def test_a_gap_between_states_is_no_measurement(drive, estimator_):
    estimator = estimator_()
    for x, ramps in drive(0.5, swerve(60))[::4]:
        assert estimator.update(x, ramps).excitation == 0.0
    assert estimator.belief.friction == pytest.approx(estimator_().belief.friction)


@pytest.mark.parametrize(
    ('targets', 'lags'),
    [(swerve(amplitude=0.15), (0.06, 0.0)), (braking(rate=4e3), (0.0, 0.06))],
    ids=['steering', 'force'],
)
def test_a_delay_that_is_known_or_doubted_is_not_taken_for_ice(
    drive, nominal, rules, targets, lags
):
    late_s, states = max(lags), drive(1.0, [STRAIGHT] * 20 + targets)
    late = [(x, [_sent_earlier(ramp, late_s) for ramp in ramps]) for x, ramps in states]

    def least(lags, error_s):
        doubted = replace(rules, lag_error_s=error_s)
        return Estimate(FrictionEstimator(doubted, nominal, lags, 1.0)).frictions(late).min()

    unknown, other, known = (least(given, 0.0) for given in (NO_LAGS, lags[::-1], lags))
    assert known > least(NO_LAGS, late_s) + 0.002 > unknown + 0.004
    assert other == pytest.approx(unknown, abs=1e-3)


def test_a_car_of_unknown_lags_is_taken_to_lag_as_its_actuators_are_compared(world, drive):
    (params, vehicle), states = world.load(**world.ESTIMATE), drive(0.5, swerve())

    def beliefs(lag_s):
        actuators = replace(vehicle.actuators, steer_lag_s=lag_s, force_lag_s=lag_s)
        controller = Controller(params, replace(vehicle, actuators=actuators))
        return Estimate(controller.parts.friction).frictions(states).tolist()

    assert beliefs(None) == beliefs(0.1) != beliefs(0.0)


def _sent_earlier(ramp, duration_s):
    shift_ns = round(duration_s * 1e9)
    return ramp._replace(begin_ns=ramp.begin_ns - shift_ns, end_ns=ramp.end_ns - shift_ns)


@pytest.mark.parametrize('factor', [1.0, 2.0])
@pytest.mark.parametrize('targets', [[STRAIGHT] * 120, braking(60, -8e3)])
def test_noise_is_measured_and_not_taken_for_ice(drive, estimator_, factor, targets):
    for seed in range(2):
        estimator = estimator_()
        frictions = estimator.frictions(drive(1.0, targets, factor=factor, seed=seed))
        assert np.mean(frictions < 0.6) < 0.05
        assert frictions[-1] > 0.75
        measured = np.sqrt(estimator.memory.noise)
        assert np.all(measured[:2] > 0.5 * factor * NOISE[:2])
        assert np.all(measured < 2.0 * factor * NOISE + 0.01)


def test_noise_that_has_ended_is_forgotten(drive, estimator_):
    estimator, noisy = estimator_(), drive(1.0, [STRAIGHT] * 60, factor=2.0)
    estimator.frictions(noisy)
    most = estimator.memory.noise
    exact = drive(1.0, [STRAIGHT] * 160)[60:]
    estimator.frictions(exact)
    assert np.all(estimator.memory.noise < 0.5 * most)


@settings(max_examples=3)
@given(friction=st.floats(0.4, 0.9), seed=st.integers(0, 9))
def test_a_swerve_tells_the_friction_through_noise(drive, estimator_, friction, seed):
    states = drive(friction, [STRAIGHT] * 40 + swerve(80), factor=1.0, seed=seed)
    assert abs(estimator_().frictions(states)[-1] - friction) < 0.25


def test_filtered_velocities_are_nearer_to_the_truth_and_without_noise_as_measured(
    drive, estimator_
):
    targets, errors = swerve(120, 0.05), []
    noisy, exact = estimator_(), estimator_()
    for (x, ramps), (measured, _) in zip(drive(1.0, targets), drive(1.0, targets, 20.0, 1.0, 3)):
        noisy.update(measured, ramps)
        filtered = noisy.filtered(measured)
        assert filtered[:4] == measured[:4]
        errors.append([np.subtract(y[4:], x[4:]) for y in (measured, filtered)])
        exact.update(x, ramps)
        np.testing.assert_allclose(exact.filtered(x), x, atol=0.01)
    before, after = np.std(np.array(errors)[40:], axis=0)
    assert np.all(after < before)
    assert np.all(after[:2] < 0.8 * before[:2])


FIELDS = st.floats(-1e3, 1e3) | st.sampled_from([np.nan, np.inf, 0.0])


@settings(max_examples=50)
@given(rows=st.lists(st.tuples(*[FIELDS] * 6), min_size=2, max_size=4), delta=st.floats(-0.5, 0.5))
def test_no_state_makes_the_belief_leave_its_range(rules, estimator_, rows, delta):
    estimator = estimator_()
    ramps = [constant_ramp(Setpoints(delta, -5e3), 0.6)]
    for k, row in enumerate(rows):
        belief = estimator.update(VehicleState(k * TICK_NS, *row), ramps)
        assert rules.lowest <= belief.friction <= 1.0
        assert np.isfinite(belief.excitation)


def test_a_wild_state_does_not_decide(drive, estimator_):
    states = drive(1.0, swerve(amplitude=0.02))
    x, ramps = states[20]
    states[20] = x._replace(vy=x.vy + 3.0, r=x.r - 2.0), ramps
    assert estimator_().frictions(states).min() > 0.8


def test_what_a_hypothesis_cannot_explain_tells_it_nothing_of_the_sideslip_error(estimator_, world):
    """Wild states: each is rejected by every hypothesis, and none gets surer of its error."""
    estimator, ramps = estimator_(), [constant_ramp(STRAIGHT, 0.6)]

    def variance_after(ticks, vy):
        """Return the variance of the sideslip error, by hypothesis."""
        for k in ticks:
            estimator.update(world.rolling(vy=vy * (-1) ** k, stamp_ns=k * TICK_NS), ramps)
        return estimator.memory.variance

    before = variance_after(range(12), 0.1)  # the noise becomes known
    wild = variance_after(range(12, 14), 4.0)
    assert np.all(wild >= before)
    assert np.all(wild < 1.01**2 * before)
    assert np.all(variance_after(range(14, 80), 0.0) < 0.8**2 * before)  # straight on


# in the controller


@pytest.fixture(scope='module')
def estimating(world, rules):
    """Return a controller that estimates, for a car without lag."""
    changes = {f'friction_estimate__{name}': value for name, value in vars(rules).items()}
    return Controller(*world.load(**changes))


def test_plans_bounds_and_brakes_take_the_believed_friction_until_a_restart(
    world, estimating, nominal, drive
):
    beliefs = []
    for _ in range(2):
        world.set_inputs(estimating, world.lane_change())
        for x, ramps in drive(0.5, swerve()):
            estimating.memory = estimating.memory._replace(ramps=tuple(ramps))
            _, _, why = world.tick(estimating, x)
            beliefs.append(why.values['friction.estimate'])
    assert beliefs[:40] == beliefs[40:]
    assert beliefs[0] > 0.85
    assert 0.4 < beliefs[-1] < 0.6
    assert estimating.car.mu_f == pytest.approx(beliefs[-1] * nominal.mu_f)
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
    assert car[:] == pytest.approx(
        nominal._replace(mu_f=braked_with * nominal.mu_f, mu_r=braked_with * nominal.mu_r)
    )
