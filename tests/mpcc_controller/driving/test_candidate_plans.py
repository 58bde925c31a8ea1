"""Several plans per tick: which is driven, which are kept, and what time and failures cost."""

import dataclasses

import numpy as np
import pytest

from mpcc_controller.driving import choose, guesses, path_progress, planner
from mpcc_controller.driving.choose import BRAKE, Candidacy, Candidate, Choice, Outcome
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.fallback import BRAKING, SHIFTED
from mpcc_controller.driving.path_progress import Progress
from mpcc_controller.driving.ways import BEHIND, LEFT, RIGHT
from msgs_yaml.types import Obstacle, Obstacles
from stage_solver.solution import FAILED, SOLVED, Solution
from stage_solver.stage_problem import Plan

TICK = 50_000_000
PLAN = Plan(np.zeros((3, 9)), np.zeros((2, 4)))


def outcome(cost, side=LEFT, rejection='', gap=0.3, **values):
    solution = Solution(PLAN._replace(), cost, SOLVED, '', 5, 0.0, 0.0, 0.0)
    values = {'off_road': 0.0} | values
    return Outcome('name', None, solution, rejection, {1: side}, gap, **values)


@pytest.fixture(scope='module')
def rules(params):
    """Return switch_share 0.02, hold_share and path_share 0.1 of the file, and a short hold."""
    return dataclasses.replace(params.candidates, hold_ticks=3)


FAILS = outcome(1.0, RIGHT, 'plan_not_feasible')
TOUCHES, LEAVES = outcome(1.0, RIGHT, gap=-0.05), outcome(1.0, RIGHT, off_road=0.2)
FAST, SLOW = (outcome(cost, gap=-1.0, contact_speed=v) for cost, v in ((10.0, 15.0), (1e4, 7.0)))


@pytest.mark.parametrize('hold', [0, 3])
@pytest.mark.parametrize(
    ('outcomes', 'path', 'chosen'),
    [
        # the cheapest one, with what it costs to regain the speed
        ([outcome(100.0, BEHIND, later=20.0), outcome(80.0, later=5.0)], {}, 1),
        ([outcome(100.0), outcome(70.0), outcome(60.0, RIGHT)], {}, 2),
        # a useless followed plan is left at once, whatever the other one costs
        *(([useless, outcome(1e4)], {}, 1) for useless in (FAILS, TOUCHES, LEAVES)),
        *(([outcome(1e4), useless], {}, 0) for useless in (FAILS, TOUCHES, LEAVES)),
        ([outcome(1.0, rejection='solver_failed'), outcome(1e4, gap=-0.5)], {}, 1),
        ([outcome(cost, gap=-0.1) for cost in (50.0, 20.0, 30.0)], {}, 1),
        ([outcome(np.nan, rejection='solver_failed')] * 2, {}, 0),
        # a millimetre of overlap does not bypass the hysteresis
        *(([outcome(100.0, gap=gap), outcome(99.0, RIGHT, gap=0.001)], {}, 0)
          for gap in (0.001, -0.001, -0.015)),
        ([outcome(99.0, RIGHT, gap=0.001), outcome(100.0, gap=-0.015)], {}, 0),
        # the side of the coarse path wins unless the other is cheaper by more
        ([outcome(100.0), outcome(95.0, RIGHT)], {1: LEFT}, 0),
        ([outcome(100.0), outcome(70.0, RIGHT)], {1: LEFT}, 1),
        # of plans that run into an obstacle the slower one; a small difference does not decide
        ([FAST, SLOW], {}, 1),
        ([SLOW, FAST], {}, 0),
        ([FAST, outcome(5.0, gap=-1.0, contact_speed=15.5)], {}, 1),
    ],
)  # fmt: skip
def test_which_plan_is_driven(rules, hold, outcomes, path, chosen):
    choice, _ = choose.choose(outcomes, path, hold, rules)
    assert choice.chosen == chosen
    assert choice.outcome is outcomes[chosen]


def test_another_plan_must_be_cheaper_by_a_share_that_is_larger_after_a_switch(rules):
    followed, better, hold = outcome(100.0), outcome(90.0, RIGHT), 0
    for cost, chosen in ((98.1, 0), (97.9, 1)):
        assert choose.choose([followed, outcome(cost)], {}, 0, rules)[0].chosen == chosen
    dear = outcome(95.0, RIGHT)  # 104.5 against the path
    assert choose.choose([dear, followed], {1: LEFT}, 0, rules)[0].chosen == 1
    switches = []
    for _ in range(5):
        choice, hold = choose.choose([followed, better], {}, hold, rules)
        switches.append(choice.switched)
    assert switches == [True, False, False, True, False]
    # on the same side, or behind an obstacle before, it is none
    for before in (LEFT, BEHIND):
        choice, hold = choose.choose([outcome(100.0, before), outcome(50.0)], {}, 0, rules)
        assert (choice.switched, hold) == (False, 0)


# what is kept for the next tick


def test_of_two_plans_of_a_way_the_cheaper_one_in_the_end_is_kept_once(rules):
    outcomes = [outcome(80.0), outcome(90.0, RIGHT, later=30.0), outcome(100.0, RIGHT, later=5.0)]
    known = choose.keep(Candidacy(), Choice(tuple(outcomes), 0, False), rules)
    (kept,) = known.kept
    assert kept.plan is outcomes[2].solution.plan
    # what is explored after the command is kept where there is no plan of its way
    after = choose.keep_new_ways(known, outcomes[0], [outcome(5.0), outcome(8.0, RIGHT)], rules)
    assert after.kept == (kept,)


def test_behind_one_far_ahead_a_cheaper_plan_of_either_side_is_kept_by_its_name(rules):
    behind = outcome(100.0, BEHIND)
    better, hardly = (outcome(cost, BEHIND)._replace(name='left of 1') for cost in (70.0, 99.0))
    (kept,) = choose.keep_new_ways(Candidacy(), behind, [better], rules).kept
    assert (kept.name, kept.plan) == ('left of 1', better.solution.plan)
    brake = outcome(70.0, BEHIND)._replace(name=BRAKE)
    for other in (hardly, brake, better._replace(least_gap=-0.05)):
        assert choose.keep_new_ways(Candidacy(), behind, [other], rules).kept == ()


def test_what_is_remembered_of_useless_guesses_does_not_grow_without_bound(rules):
    known, driven = Candidacy(), outcome(9.0)
    for key in range(1000):
        useless = outcome(10.0)._replace(name=f'left of {key}')
        for _ in range(3):
            known = choose.keep_new_ways(known, driven, [useless], rules)
    assert len(known.waits) <= 64
    assert known.waits['left of 999'] == (4 * rules.retry_ticks, 3)


def test_of_new_guesses_two_are_solved_in_a_tick_and_the_braking_one_first():
    new, old = (PLAN._replace(multipliers=m) for m in (None, object()))
    ways = [Candidate(f'left of {key}', new) for key in range(3)]
    kept, brake = Candidate('right of 1', old), Candidate('brake', new)
    assert choose.few_new([ways[0], kept, ways[1], ways[2]]) == [ways[0], kept, ways[1]]
    assert choose.few_new([ways[0], kept, ways[1], brake]) == [ways[0], kept, brake]
    assert choose.few_new([kept, brake]) == [kept, brake]


# in the controller


POP_UP = Obstacle(1, 27.0, 0.3, 1.0, 0.0, 0.0)
BESIDE = Obstacle(1, 40.0, 2.3, 1.0, 0.0, 0.0)  # the path passes it, inside the safety distance
FAR = Obstacle(2, 500.0, 30.0, 1.0, 0.0, 0.0)
CLOSED = [Obstacle(i, 30.0, 2.1 * i - 1.4, 1.1, 0.0, 0.0) for i in range(4)]  # from edge to edge


@pytest.fixture(scope='module')
def several(world):
    """Return a controller of the paper's problem, which is compiled, that compares plans."""
    return Controller(*world.load(candidates__most=4))


@pytest.fixture(scope='module')
def exploring(world):
    return Controller(*world.load(candidates__most=4, candidates__explore_after_command=True))


@pytest.fixture
def controller(several, world):
    return world.set_inputs(several, world.straight(left=6.0, right=-2.5))


@pytest.fixture
def explorer(exploring, world):
    """Return a controller that drives at 20 m/s and explores after its commands."""
    world.set_inputs(exploring, world.straight(left=6.0, right=-2.5))
    exploring.set_last_command(exploring.memory.last._replace(stamp_ns=0))
    pop_up(exploring, FAR)
    roll(exploring, world, 3)
    return exploring


def pop_up(controller, *obstacles):
    controller.set_obstacles(Obstacles(0, obstacles or (POP_UP,)))


def roll(controller, world, ticks):
    """Drive straight on for some ticks; return the reports."""
    whys = []
    for _ in range(ticks):
        stamp_ns = controller.memory.last.stamp_ns + TICK
        x = world.rolling(stamp_ns=stamp_ns, X=20.0 * stamp_ns / 1e9)
        whys.append(world.tick(controller, x)[2])
        controller.prepare()
    return whys


def names(why):
    count = why.values.get('candidates.count', 0)
    return [why.values[f'candidates.{number}.name'] for number in range(count)]


def test_without_danger_there_is_one_plan_and_the_commands_of_one_plan(
    controller, shared_controller, world
):
    world.set_inputs(shared_controller, world.straight(left=6.0, right=-2.5))
    one, many = (world.drive(c, 6) for c in (shared_controller, controller))
    assert one.commands == many.commands
    assert not any(names(why) for why in many.whys)


def test_at_a_pop_up_every_side_with_room_and_braking_are_compared_and_reported(controller, world):
    world.drive(controller, 3)
    pop_up(controller)
    _, prediction, why = world.tick(controller, world.rolling(stamp_ns=10**9))
    assert names(why) == ['followed', 'left of 1', 'brake']  # on the right there is no room
    values, chosen = why.values, why.values['candidates.chosen']
    assert values['solver.cost'] == values[f'candidates.{chosen}.cost']
    assert values['cost.total'] == pytest.approx(values['solver.cost'], rel=1e-4)
    assert values['time.solve_cpu_ms'] >= max(values[f'candidates.{i}.cpu_ms'] for i in range(3))
    line = values[f'candidates.{chosen}.line']
    points = np.array([pair.split(',') for pair in line.split()], float)
    planned = np.column_stack([prediction.X, prediction.Y])[::5]
    assert points == pytest.approx(planned, abs=0.0051)


def test_the_number_of_threads_does_not_change_a_bit_and_kept_plans_converge_sooner(
    controller, world, monkeypatch
):
    def run():
        world.set_inputs(controller, world.straight(left=6.0, right=-2.5))
        pop_up(controller)
        return world.drive(controller, 12)

    parallel, solves = run(), controller.parts.solvers.parallel
    monkeypatch.setattr(solves, 'solvers', solves.solvers[:1])
    assert parallel.commands == run().commands
    iterations = {}
    for why in parallel.whys[:8]:
        for number, name in enumerate(names(why)):
            iterations.setdefault(name, []).append(why.values[f'candidates.{number}.iterations'])
    kept = {name: counts for name, counts in iterations.items() if len(counts) > 1}
    assert {'followed', 'brake'} <= kept.keys(), iterations
    for name, counts in kept.items():
        assert np.median(counts[1:]) < counts[0], name


def explode(solution):
    raise RuntimeError('no memory')


def fail(solution):
    return solution._replace(status=FAILED, cost=np.nan)


@pytest.mark.parametrize(
    ('obstacles', 'first', 'others', 'decision'),
    [
        ([POP_UP], fail, None, (SOLVED, 'converged')),  # another candidate is driven
        ([POP_UP], None, explode, (BRAKING, 'plan_touches')),  # in a thread
        ([Obstacle(1, 40.0, 2.2, 1.0, 0.0, 0.0)], fail, fail, (SHIFTED, 'solver_failed')),
        (CLOSED, fail, fail, (BRAKING, 'plan_touches')),  # the last plan touches
    ],
)
def test_what_is_driven_when_solvers_fail(
    controller, world, monkeypatch, obstacles, first, others, decision
):
    world.drive(controller, 3)
    pop_up(controller, *obstacles)
    solvers, kept = controller.parts.solvers, lambda solution: solution
    own = world.ModifiedSolver(solvers.followed, first or kept)
    monkeypatch.setattr(solvers, 'followed', own)
    modified = [world.ModifiedSolver(s, others or kept) for s in solvers.parallel.solvers]
    monkeypatch.setattr(solvers.parallel, 'solvers', modified)
    command, _, why = world.tick(controller, world.rolling(stamp_ns=10**9))
    values = why.values
    assert (values['rung'], values['reason']) == decision
    assert values['candidates.0.status'] == ('solver_failed' if first else SOLVED)
    if others:
        assert values['candidates.1.status'] == 'solver_failed'
    assert (values['candidates.chosen'] > 0) == (decision[0] == SOLVED)
    if decision[0] == BRAKING:
        assert command.Fxf + command.Fxr < -1000.0


def watch_proposals(monkeypatch, note):
    """Call `note` with what is known before a proposal, and what it returns."""
    propose = choose.propose

    def watched(known, *arguments):
        result = propose(known, *arguments)
        note(known, *result)
        return result

    monkeypatch.setattr(choose, 'propose', watched)


def test_a_dear_plan_rests_and_is_solved_again_with_its_multipliers(controller, world, monkeypatch):
    """To pass on the far side is dear: it is compared in every third tick."""
    world.set_inputs(controller, world.straight())
    pop_up(controller, Obstacle(1, 30.0, 0.5, 1.0, 0.0, 0.0))
    solved, rested = [], []

    def note(known, after, around, proposed):
        before = {kept.name: kept for kept in known.kept}
        for candidate in proposed:
            if candidate.name in before:
                assert not before[candidate.name].rests
                assert not candidate.is_new
                solved.append(candidate.name)
        rested.extend(after.kept)

    watch_proposals(monkeypatch, note)
    world.drive(controller, 12)
    assert len(rested) > len(solved) > 0


def test_after_the_first_tick_new_guesses_are_solved_after_the_command(
    explorer, world, monkeypatch
):
    """An obstacle in the lane is compared at once; later ticks compare solved plans only."""
    pop_up(explorer, POP_UP, FAR)
    (why,) = roll(explorer, world, 1)
    assert names(why) == ['followed', 'left of 1', 'brake']
    explored, compared = [], []

    def note(known, after, around, proposed):
        compared.extend(not candidate.is_new for candidate in proposed)
        explored.extend(candidate.name for candidate in after.postponed)

    pop_up(explorer, Obstacle(1, 40.0, 1.0, 1.0, 0.0, 0.0), FAR)
    roll(explorer, world, 1)
    watch_proposals(monkeypatch, note)
    roll(explorer, world, 8)
    assert compared
    assert all(compared)
    assert 'brake' in explored
    assert explorer.memory.candidacy.kept


def test_braking_drops_kept_plans_and_guesses_that_were_put_off(explorer, world):
    pop_up(explorer, BESIDE, FAR)
    stamp_ns = explorer.memory.last.stamp_ns + TICK
    world.tick(explorer, world.rolling(stamp_ns=stamp_ns, X=20.0 * stamp_ns / 1e9))
    assert explorer.memory.candidacy.postponed
    braked, decision = planner.brake(explorer.memory, 'test')
    assert decision.level == BRAKING
    assert braked.candidacy == Candidacy()
    assert planner.explore(braked, explorer.parts) is braked


# the time of a tick on the wall clock: guesses and candidates are paid for by the solvers

LIMIT_S = 0.02
PATIENCE_S = 10.0  # for other candidates, of real time: the machine may be busy


@pytest.fixture
def timed(world):
    """Return a controller in realtime before an obstacle that appears, with timed solvers.

    Its clock stands but for what `delay(function, seconds)` takes.
    """
    settings = world.load(
        candidates__most=4, fallback__recovery=True, solver__time_limit_s=LIMIT_S,
        solver__patience_s=PATIENCE_S, surroundings__max_obstacles=4,
    )  # fmt: skip
    controller = Controller(*settings, True, world.Clock())
    solvers = controller.parts.solvers
    for name in ('followed', 'sliding'):
        setattr(solvers, name, world.ModifiedSolver(getattr(solvers, name)))
    solvers.parallel.solvers = [world.ModifiedSolver(s) for s in solvers.parallel.solvers]
    world.set_inputs(controller, world.straight(left=6.0, right=-2.5))
    pop_up(controller)
    return controller


def delay(controller, function, takes_s):
    """Return a function that takes time on the clock of a controller."""

    def delayed(*arguments, **named):
        controller.parts.clock.now += takes_s
        return function(*arguments, **named)

    return delayed


@pytest.mark.parametrize(
    ('owner', 'name', 'vy', 'takes_s'),
    [
        (choose, 'propose', 0.0, 0.003),
        (guesses, 'from_recovery', 8.0, 0.004),
        (choose, 'propose', 0.0, 1.0),  # no time is left, and the tick still answers
    ],
)
def test_the_time_to_guess_is_taken_from_the_solvers(
    timed, world, monkeypatch, owner, name, vy, takes_s
):
    monkeypatch.setattr(owner, name, delay(timed, getattr(owner, name), takes_s))
    *_, why = world.tick(timed, world.rolling(vy=vy))
    solvers, left_s = timed.parts.solvers, max(LIMIT_S - takes_s, 0.0)
    own = solvers.sliding if vy else solvers.followed
    assert own.limits_s == pytest.approx([left_s])
    others = [limit for solver in solvers.parallel.solvers for limit in solver.limits_s]
    if left_s and not vy:
        assert others == pytest.approx([left_s] * 2)
    if not left_s:
        assert 'candidates.count' not in why.values


def test_other_candidates_are_waited_for_in_the_time_of_all_solvers(timed, world, monkeypatch):
    """What hangs beyond that holds no tick: test_parallel_solves.py."""
    solvers, waited_s = timed.parts.solvers, []
    run = solvers.parallel.run

    def watched(own, jobs, patience_s):
        result = run(own, jobs, patience_s)
        waited_s.append(patience_s())
        return result

    monkeypatch.setattr(solvers.parallel, 'run', watched)
    solvers.solve = delay(timed, solvers.solve, PATIENCE_S - 1.0)
    world.tick(timed, world.rolling())
    assert waited_s == pytest.approx([1.0])


@pytest.mark.parametrize(
    ('build_s', 'built'),
    [
        (0.001, ['left of 1', 'right of 1', BRAKE]),
        (0.004, ['left of 1', BRAKE]),
        (0.006, ['left of 1']),
    ],
)
def test_late_candidates_are_dropped_the_first_way_last_then_the_plan_that_brakes(
    timed, world, build_s, built
):
    parts, scene, now = timed.parts, world.scene(world.straight()), timed.memory.ramp.end
    x = world.rolling()
    _, x0 = path_progress.initial_state(Progress(), x, now, scene, None, parts.params)
    guess = guesses.from_recovery(x0, scene.path, timed.car, parts.model.step, parts.params)
    others = [Candidate(name, guess) for name in ('left of 1', 'right of 1', BRAKE)]
    parts.model.build_problem = delay(timed, parts.model.build_problem, build_s)
    arguments = x0, scene, others, timed.car
    assert list(planner._build(*arguments, parts.clock(), parts)) == built
    parts.limit_time = False
    assert len(planner._build(*arguments, parts.clock(), parts)) == 3


def test_a_solver_that_fails_after_the_command_costs_the_guess_only(explorer, world, monkeypatch):
    pop_up(explorer, BESIDE, FAR)
    solves = explorer.parts.solvers.parallel
    failing = [world.ModifiedSolver(solver, explode) for solver in solves.solvers]
    monkeypatch.setattr(solves, 'solvers', failing)
    assert [why.values['rung'] for why in roll(explorer, world, 2)] == [SOLVED, SOLVED]
    assert explorer.memory.candidacy.kept == ()
