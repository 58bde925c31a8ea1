"""One plan per tick: which guess, which problems, which solution, and what fallback. SI units.

Every function takes the memory of the ticks before and returns the one after.
"""

from functools import partial

from mpcc_controller.driving import choose, guesses
from mpcc_controller.driving.choose import BRAKE, FOLLOWED, Candidacy
from mpcc_controller.driving.fallback import Decision
from mpcc_controller.driving.parts import Parts
from mpcc_controller.driving.prediction_model import TickProblem
from mpcc_controller.driving.records import Attempt, Memory
from mpcc_controller.driving.ways import BEHIND
from mpcc_controller.model.single_track import Car, State
from mpcc_controller.parameters import REFRESHED
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.conversions import add_seconds
from stage_solver.stage_problem import shift

PLAN_TOUCHES = 'plan_touches'  # an obstacle before which the car can stop
BUILDING_SHARE = 0.25  # of `solver.time_limit_s` in which the problems of candidates are built


def plan(
    memory: Memory, x0: State, scene: Scene, car: Car, sliding: bool, parts: Parts
) -> tuple[Memory, Decision, Attempt]:
    """Return what to drive from `x0`, and the solutions that led to it.

    A car that is `sliding` is to be recovered where there is no plan, and the recovery law then
    drives the guess.
    """
    began = parts.clock()
    params, model, solvers, plans = parts.params, parts.model, parts.solvers, memory.plans
    warm = plans.is_warm(params.fallback)
    shifted = None if plans.plan is None else model.shift_to(plans.plan, x0, car)
    from_law = sliding and (not warm or bool(plans.failures))
    if from_law:
        guess = guesses.from_recovery(x0, scene.path, car, model.step, params)
    elif not warm:
        guess = guesses.from_path(scene.path, x0, car, params.model.horizon, params.model.step_s)
    else:  # without the multipliers from which the solver failed
        guess = shifted._replace(multipliers=None) if plans.failures else shifted
    problem = model.build_problem(x0, scene, guess, car, sliding)
    candidacy, around, others = memory.candidacy, None, {}
    if parts.compares:
        candidacy, around, proposed = choose.propose(candidacy, x0, scene, guess, car, model)
        others = _build(x0, scene, proposed, car, began, parts)
    prepare_s = parts.clock() - began
    # where plans are compared the time limit of the solvers counts building their problems, too
    solving = began if parts.compares or from_law else began + prepare_s
    first_guess = problem.guess_local
    if memory.prepared is not None and guess.multipliers is not None:
        # the stage parameters stay those around the shifted plan: preparation changes the way to
        # the solution and not the problem
        prepared = guesses.start_at(memory.prepared, x0)
        first_guess = model.formulation.to_local(prepared, scene.path)
    choice, refreshes, compare_s = None, None, None
    if others:
        compared = parts.clock()
        first, solutions = solvers.solve_candidates(
            [*others.values()], solving, partial(solvers.solve, problem, first_guess, solving)
        )
        compare_s = parts.clock() - compared
        problems = {FOLLOWED: problem, **others}
        outcomes = choose.judge(problems, [first, *solutions], around, params)
        path_sides = {h.id: h.path_side for h in around.hazards if h.path_side != BEHIND}
        choice, hold = choose.choose(outcomes, path_sides, candidacy.hold, params.candidates)
        candidacy = choose.keep(candidacy._replace(hold=hold), choice, params.candidates)
        problem, solution = choice.outcome.problem, choice.outcome.solution
    else:
        solution = solvers.solve(problem, first_guess, solving)
    if params.surroundings.arcs == REFRESHED:
        problem, solution, refreshes = solvers.refresh_arcs(parts.model, problem, solution, solving)
    if parts.compares:
        usable = solution.plan if solvers.is_usable(solution) else None
        candidacy = choose.follow(candidacy, usable, solution.cost, scene, params)

    def objection(plan):
        touches = around is not None and not sliding
        cars = car, model.car_to_brake(memory.believed)
        touches = touches and choose.is_braking_better(plan, x0, guess, scene, *cars, params)
        return PLAN_TOUCHES if touches else ''

    plans, decision = plans.decide(params.fallback, solution, shifted, sliding, objection)
    attempt = Attempt(
        problem=problem,
        solution=solution,
        plan=decision.plan,
        warm=warm,
        prepare_s=prepare_s,
        solve_s=solution.solve_s if compare_s is None else compare_s,
        plan_age=plans.age,
        failures=plans.failures,
        choice=choice,
        around=around,
        refreshes=refreshes,
    )
    memory = memory._replace(plans=plans, candidacy=candidacy, solved=attempt, prepared=None)
    return memory, decision, attempt


def prepare(memory: Memory, scene: Scene, parts: Parts) -> Memory:
    """Solve the problem expected at the next tick; its plan becomes the guess there.

    The expected state is that of the plan, `scene` that of the next tick. Nothing is prepared
    without a plan, and after a failure.
    """
    plans, car = memory.plans, parts.model.car_on(memory.believed)
    if plans.plan is None or plans.failures:
        return memory._replace(prepared=None)
    x0 = State(*plans.plan.X[1])
    guess = parts.model.shift_to(plans.plan, x0, car)
    solution = parts.solvers.solve(parts.model.build_problem(x0, scene, guess, car))
    return memory._replace(prepared=solution.plan if parts.solvers.is_usable(solution) else None)


def explore(memory: Memory, parts: Parts) -> Memory:
    """Solve the new guesses that the last tick put off until its command was sent.

    From the state and scene of that tick; usable plans compete at the next one.
    """
    postponed = memory.candidacy.postponed
    if not postponed:
        return memory
    solved, began = memory.solved, parts.clock()
    last = solved.problem
    problems = _build(last.x0, last.scene, postponed, last.car, began, parts)
    _, solutions = parts.solvers.solve_candidates([*problems.values()], began)
    outcomes = choose.judge(problems, solutions, solved.around, parts.params)
    if solved.choice:
        driven = solved.choice.outcome
    else:
        alone = {FOLLOWED: last}, [solved.solution]
        (driven,) = choose.judge(*alone, solved.around, parts.params)
    candidacy = memory.candidacy._replace(postponed=())
    rules = parts.params.candidates
    return memory._replace(candidacy=choose.keep_new_ways(candidacy, driven, outcomes, rules))


def brake(memory: Memory, reason: str, sliding: bool = False) -> tuple[Memory, Decision]:
    """Return the decision to brake, or to recover a sliding car, without solving.

    The other plans are dropped: without a solve they grow older.
    """
    plans, decision = memory.plans.brake(reason, sliding)
    return memory._replace(plans=plans, candidacy=Candidacy()), decision


def continue_plan(
    memory: Memory, reason: str, ticks: int, car: Car, parts: Parts
) -> tuple[Memory, Decision]:
    """Return the decision for a tick with an unknown state: the plan goes on as planned.

    `ticks` have passed since the last command.
    """
    params, plans, progress = parts.params, memory.plans, memory.progress
    most = params.fallback.max_plan_age + 1  # then it brakes, however many there were
    for _ in range(min(max(ticks, 1), most)):
        shifted = plans.plan
        if shifted is not None:
            shifted = shift(shifted, parts.model.step, car)
            stage_ns = add_seconds(progress.stage_ns, params.model.step_s)
            progress = progress._replace(stage_ns=stage_ns)
        plans, decision = plans.follow_shifted(params.fallback, reason, shifted)
    memory = memory._replace(plans=plans, progress=progress, candidacy=Candidacy())
    return memory, decision


def _build(x0, scene, proposed, car, began, parts) -> dict[str, TickProblem]:
    """Return the problems of candidates by name, in the order of `proposed`.

    With a time limit those for which there is no time are dropped: the first way around the
    obstacles comes first, then the plan that brakes, then the other ways.
    """
    built: dict[str, TickProblem] = {}
    late_s = BUILDING_SHARE * parts.params.solver.time_limit_s
    for candidate in (*proposed[:1], *sorted(proposed[1:], key=lambda c: c.name != BRAKE)):
        if parts.limit_time and parts.clock() - began > late_s:
            break
        problem = parts.model.build_problem(x0, scene, candidate.guess, car)
        built[candidate.name] = problem
    return {c.name: built[c.name] for c in proposed if c.name in built}
