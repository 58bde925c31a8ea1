"""The time of a tick on the wall clock: guesses and candidates are paid for by the solvers."""

import threading
import time

import pytest

from mpcc_controller.driving import choose, path_progress, planner
from mpcc_controller.driving.choose import BRAKE, Candidate
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.path_progress import Progress
from msgs_yaml.types import Obstacle, Obstacles

LIMIT_S = 0.02
PATIENCE_S = 10.0  # for other candidates, of real time: the machine may be busy


class TimedSolver:
    """A solver that notes the time limit of each solve."""

    def __init__(self, inner):
        self.inner, self.limit_s, self.limits_s = inner, None, []

    def set_time_limit(self, seconds):
        self.limit_s = seconds
        self.inner.set_time_limit(10.0)  # the machine may be busy

    def solve(self, *arguments):
        self.limits_s.append(self.limit_s)
        return self.inner.solve(*arguments)


class HangingSolver:
    """A solver that does not return until it is released."""

    def __init__(self):
        self.begun, self.release = False, threading.Event()

    def set_time_limit(self, seconds):
        pass

    def solve(self, *arguments):
        self.begun = True
        self.release.wait(60.0)


class Clock:
    """A clock that advances only when a test sets `now`."""

    now = 0.0

    def __call__(self):
        return self.now

    def delay(self, function, takes_s):
        """Return a function that takes time on this clock."""

        def delayed(*arguments, **named):
            self.now += takes_s
            return function(*arguments, **named)

        return delayed


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def controller(world, clock):
    """Return a controller in realtime before an obstacle that appears, with timed solvers."""
    settings = world.load(
        candidates__most=4, fallback__recovery=True, solver__time_limit_s=LIMIT_S,
        solver__patience_s=PATIENCE_S, surroundings__max_obstacles=4,
    )  # fmt: skip
    controller = Controller(*settings, True, clock)
    solvers = controller.parts.solvers
    solvers.first, solvers.sliding = TimedSolver(solvers.first), TimedSolver(solvers.sliding)
    solvers.parallel.solvers = [TimedSolver(solver) for solver in solvers.parallel.solvers]
    world.set_inputs(controller, world.straight(left=6.0, right=-2.5))
    controller.set_obstacles(Obstacles(0, (Obstacle(1, 27.0, 0.3, 1.0, 0.0, 0.0),)))
    return controller


def test_the_time_to_build_candidates_is_taken_from_their_solvers(
    controller, clock, world, monkeypatch
):
    monkeypatch.setattr(choose, 'propose', clock.delay(choose.propose, 0.003))
    world.tick(controller, world.rolling())
    assert controller.parts.solvers.first.limits_s == pytest.approx([LIMIT_S - 0.003])
    others = [
        limit for solver in controller.parts.solvers.parallel.solvers for limit in solver.limits_s
    ]
    assert others == pytest.approx([LIMIT_S - 0.003] * 2)


def test_the_time_to_guess_what_recovers_a_sliding_car_is_taken_from_its_solver(
    controller, clock, world, monkeypatch
):
    monkeypatch.setattr(planner, 'guess_from_law', clock.delay(planner.guess_from_law, 0.004))
    world.tick(controller, world.rolling(vy=8.0))
    assert controller.parts.solvers.sliding.limits_s == pytest.approx([LIMIT_S - 0.004])


def test_other_candidates_that_do_not_return_hold_no_tick(controller, clock, world):
    solvers, hanging = controller.parts.solvers, HangingSolver()
    solvers.parallel.solvers = [hanging] * len(solvers.parallel.solvers)
    solvers.solve_first = clock.delay(solvers.solve_first, PATIENCE_S - 0.01)
    controller.set_obstacles(Obstacles(0, (Obstacle(1, 32.0, 1.2, 1.0, 0.0, 0.0),)))
    began = time.monotonic()
    try:
        for k in range(3):
            *_, why = world.tick(controller, world.rolling(stamp_ns=k * 50_000_000, X=float(k)))
            assert (why.values['rung'], why.values['reason']) == ('solved', 'converged')
        assert hanging.begun
        assert time.monotonic() - began < 50.0
    finally:
        hanging.release.set()


def test_a_tick_that_has_no_time_left_still_answers(controller, clock, world, monkeypatch):
    monkeypatch.setattr(choose, 'propose', clock.delay(choose.propose, 1.0))
    *_, why = world.tick(controller, world.rolling())
    assert controller.parts.solvers.first.limits_s == [0.0]
    assert 'candidates.count' not in why.values


@pytest.mark.parametrize(
    ('build_s', 'built'),
    [
        (0.001, ['left of 1', 'right of 1', BRAKE]),
        (0.004, ['left of 1', BRAKE]),
        (0.006, ['left of 1']),
    ],
)
def test_late_candidates_are_dropped_the_first_way_last_then_the_plan_that_brakes(
    controller, clock, world, build_s, built
):
    parts, scene = controller.parts, controller.scene
    now = controller.active_ramp.end
    x = world.rolling()
    _, x0 = path_progress.initial_state(Progress(), x, now, scene, None, parts.params)
    guess = planner.guess_from_law(x0, scene, controller.car, parts)
    others = [Candidate(name, guess) for name in ('left of 1', 'right of 1', BRAKE)]
    parts.model.build_problem = clock.delay(parts.model.build_problem, build_s)
    arguments = x0, scene, others, controller.car
    assert list(planner._build(*arguments, clock(), parts)) == built
    parts.limit_time = False
    assert len(planner._build(*arguments, clock(), parts)) == 3
