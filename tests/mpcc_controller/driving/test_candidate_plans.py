"""Several plans per tick in the closed loop: threads, failures, memory, reports."""

from itertools import pairwise

import numpy as np
import pytest

from mpcc_controller.driving import choose, planner
from mpcc_controller.driving.choose import Candidacy, Candidate, Choice, Outcome, few_new
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.fallback import BRAKING
from mpcc_controller.driving.ways import LEFT, RIGHT
from mpcc_controller.model.single_track import State
from msgs_yaml.types import Obstacle, Obstacles
from stage_solver.solution import FAILED, SOLVED, Solution
from stage_solver.stage_problem import Plan

POP_UP = Obstacle(1, 27.0, 0.3, 1.0, 0.0, 0.0)


@pytest.fixture(scope='module')
def several(world):
    """Return a controller of the paper's problem, which is compiled, that compares plans."""
    return Controller(*world.load(candidates__most=4))


@pytest.fixture
def controller(several, world):
    return world.set_inputs(several, world.straight(left=6.0, right=-2.5))


def pop_up(controller, *obstacles):
    controller.set_obstacles(Obstacles(0, obstacles or (POP_UP,)))


@pytest.fixture(scope='module')
def exploring(world):
    return Controller(*world.load(candidates__most=4, candidates__explore_after_command=True))


FAR = Obstacle(2, 500.0, 30.0, 1.0, 0.0, 0.0)
BESIDE = Obstacle(1, 40.0, 2.3, 1.0, 0.0, 0.0)  # the path passes it, inside the safety distance


def roll(controller, world, ticks, prepares=True):
    """Drive straight on for some ticks; return the reports."""
    whys = []
    for _ in range(ticks):
        stamp_ns = controller.last_command.stamp_ns + 50_000_000
        x = world.rolling(stamp_ns=stamp_ns, X=20.0 * stamp_ns / 1e9)
        whys.append(world.tick(controller, x)[2])
        if prepares:
            controller.prepare()
    return whys


def names(why):
    count = why.values.get('candidates.count', 0)
    return [why.values[f'candidates.{number}.name'] for number in range(count)]


def test_without_danger_there_is_one_plan_and_the_commands_of_one_plan(
    controller, shared_controller, world
):
    world.set_inputs(shared_controller, world.straight(left=6.0, right=-2.5))
    one, many = (world.drive(c, 10) for c in (shared_controller, controller))
    assert one.commands == many.commands
    assert not any(names(why) for why in many.whys)


def test_at_a_pop_up_every_side_with_room_and_braking_are_compared(controller, world):
    world.drive(controller, 3)
    pop_up(controller)
    _, _, why = world.tick(controller, world.rolling(stamp_ns=10**9))
    assert names(why) == ['followed', 'left of 1', 'brake']  # on the right there is no room
    chosen = why.values['candidates.chosen']
    costs = [why.values[f'candidates.{i}.cost'] for i in range(3)]
    assert why.values['solver.cost'] == costs[chosen]
    assert why.values['cost.total'] == pytest.approx(costs[chosen], rel=1e-4)
    assert why.values['time.solve_cpu_ms'] >= max(
        why.values[f'candidates.{i}.cpu_ms'] for i in range(3)
    )


def test_the_line_of_the_chosen_candidate_is_the_prediction(controller, world):
    pop_up(controller)
    _, prediction, why = world.tick(controller, world.rolling(stamp_ns=10**9))
    line = why.values[f'candidates.{why.values["candidates.chosen"]}.line']
    points = np.array([pair.split(',') for pair in line.split()], float)
    planned = np.column_stack([prediction.X, prediction.Y])[::5]
    assert points == pytest.approx(planned, abs=0.0051)


def test_the_number_of_threads_does_not_change_a_bit(controller, world, monkeypatch):
    def run():
        world.set_inputs(controller, world.straight(left=6.0, right=-2.5))
        pop_up(controller)
        return world.drive(controller, 25)

    assert len(controller.parts.solvers.parallel.solvers) >= 1
    parallel = run()
    solves = controller.parts.solvers.parallel
    monkeypatch.setattr(solves, 'solvers', solves.solvers[:1])
    alone = run()
    assert parallel.commands == alone.commands
    assert any(names(why) for why in parallel.whys)


def test_a_kept_plan_converges_in_fewer_iterations_than_its_first_guess(controller, world):
    pop_up(controller)
    whys = world.drive(controller, 8).whys
    iterations = {}
    for why in whys:
        for number, name in enumerate(names(why)):
            iterations.setdefault(name, []).append(why.values[f'candidates.{number}.iterations'])
    kept = {name: counts for name, counts in iterations.items() if len(counts) > 1}
    assert {'followed', 'brake'} <= kept.keys(), iterations
    for name, counts in kept.items():
        assert np.median(counts[1:]) < counts[0], name


def test_when_the_followed_plan_fails_another_candidate_is_driven(controller, world, monkeypatch):
    world.drive(controller, 3)
    pop_up(controller)
    fail = world.ModifiedSolver(
        controller.parts.solvers.first, lambda s: s._replace(status=FAILED, cost=np.nan)
    )
    monkeypatch.setattr(controller.parts.solvers, 'first', fail)
    _, _, why = world.tick(controller, world.rolling(stamp_ns=10**9))
    assert why.values['rung'] == SOLVED
    assert why.values['candidates.chosen'] > 0
    assert why.values['candidates.0.status'] == 'solver_failed'


def test_when_all_candidates_fail_the_last_plan_goes_on(controller, world, monkeypatch):
    world.drive(controller, 3)
    pop_up(controller, Obstacle(1, 40.0, 2.2, 1.0, 0.0, 0.0))  # near, but beside the path

    def failing(solver):
        return world.ModifiedSolver(solver, lambda s: s._replace(status=FAILED, cost=np.nan))

    solvers = controller.parts.solvers
    monkeypatch.setattr(solvers, 'first', failing(solvers.first))
    others = [failing(solver) for solver in solvers.parallel.solvers]
    monkeypatch.setattr(solvers.parallel, 'solvers', others)
    _, _, why = world.tick(controller, world.rolling(stamp_ns=10**9))
    assert why.values['rung'] == 'shifted'


def test_a_solver_that_raises_in_a_thread_is_a_candidate_that_failed(
    controller, world, monkeypatch
):
    world.drive(controller, 3)
    pop_up(controller)

    def explode(solution):
        raise RuntimeError('no memory')

    solvers = controller.parts.solvers
    others = [world.ModifiedSolver(solver, explode) for solver in solvers.parallel.solvers]
    monkeypatch.setattr(solvers.parallel, 'solvers', others)
    _, _, why = world.tick(controller, world.rolling(stamp_ns=10**9))
    assert why.values['candidates.0.status'] == SOLVED
    assert why.values['candidates.chosen'] == 0
    assert why.values['candidates.1.status'] == 'solver_failed'


def test_braking_forgets_the_plans_that_were_kept(controller, world):
    pop_up(controller)
    world.drive(controller, 3)
    assert controller.memory.candidacy.kept
    memory, decision = planner.brake(controller.memory, 'test')
    assert decision.level == BRAKING
    assert memory.candidacy == Candidacy()


def test_an_oncoming_car_is_passed_that_one_plan_brakes_for(controller, shared_controller, world):
    x = State(0.0, 0.0, 0.0, 17.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def least_gap_and_speed(chosen):
        world.set_inputs(chosen, world.straight(v=17.0, left=6.0, right=-2.5))
        chosen.set_obstacles(Obstacles(0, (Obstacle(1, 100.0, 0.66, 1.0, -15.0, 0.0),)))
        states = world.drive(chosen, 105, x).states
        t = 0.05 * np.arange(len(states.X))
        return np.min(np.hypot(states.X - (100 - 15 * t), states.Y - 0.66)) - 2.1, states.vx.min()

    one, many = least_gap_and_speed(shared_controller), least_gap_and_speed(controller)
    assert one[0] < 0.0
    assert many[0] > 0.2


def test_a_car_brakes_to_a_stop_where_every_plan_leads_through_the_obstacles(controller, world):
    """A plan drives at least 7 m/s: before a closed road it leads into the barrier."""
    wall = [Obstacle(key, 40.0, y, 1.1, 0.0, 0.0) for key, y in enumerate((-2.0, 0.2, 2.4, 4.6), 1)]
    x = State(0.0, 0.0, 0.0, 15.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    world.set_inputs(controller, world.straight(v=15.0, left=6.0, right=-2.5))
    pop_up(controller, *wall)
    run = world.drive(controller, 70, x)
    nearest = min(np.min(np.hypot(run.states.X - o.X, run.states.Y - o.Y)) for o in wall) - 2.2
    assert nearest > 0.0
    assert run.states.vx[-1] < 2.0
    assert 'plan_touches' in {why.values['reason'] for why in run.whys}


def test_a_car_before_a_closed_road_brakes_and_does_not_drive_on_through_it(world):
    """Four discs from edge to edge, so near that the circles touch however hard the car brakes."""
    controller = world.set_inputs(
        Controller(*world.load(candidates__most=4)), world.straight(left=6.0, right=-2.5)
    )
    wall = [Obstacle(i, 24.0, y, 1.1, 0.0, 0.0) for i, y in enumerate((-1.4, 0.7, 2.8, 4.9))]
    pop_up(controller, *wall)
    drive = world.drive(controller, 15)
    assert all(why.values['reason'] == 'plan_touches' for why in drive.whys)
    forces = [command.Fxf + command.Fxr for command in drive.commands]
    assert all(later <= earlier for earlier, later in pairwise(forces))
    assert forces[-1] < -12e3


def test_the_last_plan_is_not_driven_where_it_touches(world):
    """The wall closes the road, and all solvers fail."""
    controller = world.set_inputs(
        Controller(*world.load(candidates__most=4)), world.straight(left=6.0, right=-2.5)
    )
    world.drive(controller, 3)
    wall = [Obstacle(i, 30.0, y, 1.1, 0.0, 0.0) for i, y in enumerate((-1.4, 0.7, 2.8, 4.9))]
    pop_up(controller, *wall)

    def failing(solver):
        return world.ModifiedSolver(solver, lambda s: s._replace(status=FAILED, cost=np.nan))

    solvers = controller.parts.solvers
    solvers.first = failing(solvers.first)
    solvers.parallel.solvers = [failing(solver) for solver in solvers.parallel.solvers]
    command, _, why = world.tick(controller, world.rolling(stamp_ns=10**9))
    assert (why.values['rung'], why.values['reason']) == (BRAKING, 'plan_touches')
    assert command.Fxf + command.Fxr < -1000.0


def test_what_is_remembered_of_useless_guesses_does_not_grow_without_bound(several):
    rules, known, driven = several.params.candidates, Candidacy(), outcome_of(LEFT, 9.0)
    for key in range(1000):
        useless = outcome_of(LEFT, 10.0)._replace(name=f'left of {key}')
        for _ in range(3):
            known = choose.keep_new_ways(known, driven, [useless], rules)
    assert len(known.waits) <= 64
    assert known.waits['left of 999'] == (4 * rules.retry_ticks, 3)


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
                assert candidate.guess.multipliers is not None
                solved.append(candidate.name)
        rested.extend(after.kept)

    watch_proposals(monkeypatch, note)
    world.drive(controller, 12)
    assert len(rested) > len(solved) > 0


def test_of_two_plans_of_one_way_the_one_that_is_cheaper_in_the_end_is_kept(several):
    outcomes = [
        outcome_of(side, cost)._replace(later=later)
        for side, cost, later in ((LEFT, 80.0, 0.0), (RIGHT, 90.0, 30.0), (RIGHT, 100.0, 5.0))
    ]
    choice = Choice(tuple(outcomes), 0, False)
    (kept,) = choose.keep(Candidacy(), choice, several.params.candidates).kept
    assert kept.plan is outcomes[2].solution.plan


def test_of_new_guesses_two_are_solved_in_a_tick_and_the_braking_one_first():
    new, old = (Plan(np.zeros((3, 9)), np.zeros((2, 4)), m) for m in (None, object()))
    ways = [Candidate(f'left of {key}', new) for key in range(3)]
    kept, brake = Candidate('right of 1', old), Candidate('brake', new)
    assert few_new([ways[0], kept, ways[1], ways[2]]) == [ways[0], kept, ways[1]]
    assert few_new([ways[0], kept, ways[1], brake]) == [ways[0], kept, brake]
    assert few_new([kept, brake]) == [kept, brake]


def explorer_at_20_mps(exploring, world):
    controller = world.set_inputs(exploring, world.straight(left=6.0, right=-2.5))
    controller.set_last_command(controller.last_command._replace(stamp_ns=0))
    pop_up(controller, FAR)
    roll(controller, world, 3)
    return controller


def test_after_the_first_tick_new_guesses_are_solved_after_the_command(
    exploring, world, monkeypatch
):
    """An obstacle in the lane is compared at once; later ticks compare solved plans only."""
    controller = explorer_at_20_mps(exploring, world)
    pop_up(controller, Obstacle(1, 40.0, 1.0, 1.0, 0.0, 0.0), FAR)
    explored, compared = [], []
    roll(controller, world, 1)

    def note(known, after, around, proposed):
        compared.extend(not candidate.is_new for candidate in proposed)
        explored.extend(candidate.name for candidate in after.postponed)

    watch_proposals(monkeypatch, note)
    roll(controller, world, 8)
    assert compared
    assert all(compared)
    assert 'brake' in explored
    assert controller.memory.candidacy.kept


def outcome_of(side, cost):
    plan = Plan(np.zeros((3, 9)), np.zeros((2, 4)), None)
    solution = Solution(plan, cost, SOLVED, '', 5, 0.0, 0.0, 0.0)
    return Outcome('way', None, solution, '', {1: side}, 0.3, 0.0)


def test_of_what_was_explored_ways_without_a_plan_are_kept(exploring):
    rules = exploring.params.candidates
    driven, same, other = outcome_of(LEFT, 9.0), outcome_of(LEFT, 5.0), outcome_of(RIGHT, 10.0)
    known = choose.keep_new_ways(Candidacy(), driven, [same, other], rules)
    (kept,) = known.kept
    assert kept.plan is other.solution.plan
    # there is one of this way already
    assert choose.keep_new_ways(known, driven, [outcome_of(RIGHT, 8.0)], rules).kept == (kept,)


def test_guesses_that_were_put_off_are_dropped_with_their_tick(exploring, world):
    controller = explorer_at_20_mps(exploring, world)
    pop_up(controller, BESIDE, FAR)
    roll(controller, world, 1, prepares=False)
    braked, _ = planner.brake(controller.memory, 'test')
    assert planner.explore(braked, controller.parts) is braked


def test_a_tick_whose_followed_plan_touches_does_not_wait(exploring, world):
    controller = explorer_at_20_mps(exploring, world)
    pop_up(controller, POP_UP, FAR)
    (why,) = roll(controller, world, 1)
    assert names(why) == ['followed', 'left of 1', 'brake']


def test_a_solver_that_fails_after_the_command_costs_the_guess_only(exploring, world, monkeypatch):
    controller = explorer_at_20_mps(exploring, world)
    pop_up(controller, BESIDE, FAR)
    solvers = controller.parts.solvers

    def explode(solution):
        raise RuntimeError('no memory')

    solves = solvers.parallel
    failing = [world.ModifiedSolver(solver, explode) for solver in solves.solvers]
    monkeypatch.setattr(solves, 'solvers', failing)
    assert [why.values['rung'] for why in roll(controller, world, 2)] == [SOLVED, SOLVED]
    assert controller.memory.candidacy.kept == ()
