"""One plan per tick: which guess, which problems, which solution, and what fallback. SI units."""

from collections.abc import Callable, Sequence
from functools import partial

from mpcc_controller.driving import fallback, initial_guess, recovery
from mpcc_controller.driving.candidate_choice import Outcome
from mpcc_controller.driving.candidate_guesses import BRAKE, FOLLOWED, Candidate
from mpcc_controller.driving.candidate_plans import CandidatePlans
from mpcc_controller.driving.fallback import Decision, FallbackLogic
from mpcc_controller.driving.path_progress import PathProgress
from mpcc_controller.driving.prediction_model import PredictionModel, TickProblem
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.driving.tick import Attempt, Comparison
from mpcc_controller.driving.tick_solvers import TickSolvers
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import REFRESHED, CarParams, ControllerParams
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import VehicleState
from stage_solver.solution import Solution
from stage_solver.stage_problem import Plan, shift

PLAN_TOUCHES = 'plan_touches'  # an obstacle before which the car can stop
BUILDING_SHARE = 0.25  # of `solver.time_limit_s` in which the problems of candidates are built


class Planner:
    """Solves the problem once per tick; carries plan and path distance over to the next tick."""

    def __init__(
        self,
        params: ControllerParams,
        vehicle: CarParams,
        limit_time: bool,
        clock: Callable[[], float],
    ):
        """`limit_time` lets the solvers stop at their wall-time limits; `clock` is in s."""
        self.limit_time = limit_time
        self.clock = clock
        self.prediction = PredictionModel(params, vehicle)
        params = self.prediction.params
        compares = (params.candidates.most or 1) > 1
        self.alternatives = CandidatePlans(self.prediction) if compares else None
        self.solvers = TickSolvers(self.prediction, limit_time, clock)
        self.progress = PathProgress(params)
        self.reset()

    def reset(self) -> None:
        """Drop the plan and the path distance: the next tick starts cold."""
        self.fallback = FallbackLogic(self.prediction.params.fallback)
        self.progress.reset()
        self.last_problem: TickProblem | None = None
        self.prepared: Plan | None = None  # solution of the problem expected next
        self._solved_last: Outcome | Solution | None = None  # what the last tick chose
        self._forget_alternatives()

    def warm_up(self) -> None:
        """Let the solvers of slides and candidates solve the last problem once."""
        if self.last_problem is not None:
            self.solvers.warm_up(self.last_problem)

    def initial_state(self, x: VehicleState, now: Setpoints, scene: Scene) -> State:
        """Return the state of stage 0; see `PathProgress.initial_state`."""
        return self.progress.initial_state(x, now, scene, self.fallback.plan)

    def plan(self, x0: State, scene: Scene, sliding: bool = False) -> tuple[Decision, Attempt]:
        """Return what to drive from `x0`, and the solutions that led to it.

        A car that is `sliding` is to be recovered where there is no plan, and the recovery law
        then drives the guess.
        """
        began = self.clock()
        warm, shifted = self.fallback.is_warm, self._shifted_plan(x0)
        from_law = sliding and (not warm or bool(self.fallback.failures))
        guess = self.guess_from_law(x0, scene) if from_law else self._guess(x0, scene, shifted)
        problem = self.prediction.build_problem(x0, scene, guess, sliding)
        proposed = self.alternatives.propose(x0, scene, guess) if self.alternatives else []
        others = self._build_others(x0, scene, proposed, began)
        prepare_s = self.clock() - began
        # what the paper's controller does not do is paid for by the solvers
        solving = began if self.alternatives or from_law else began + prepare_s
        comparison, refreshes = None, None
        if others:
            comparison = self._compare(problem, others, solving)
            problem, first = comparison.choice.outcome.problem, comparison.choice.outcome.solution
        else:
            first = self.solvers.solve_first(problem, self._take_guess(problem), solving)
        if self.prediction.params.surroundings.arcs == REFRESHED:
            problem, first, refreshes = self.solvers.refresh_arcs(problem, first, solving)
        self.last_problem = problem
        if self.alternatives:
            usable = self.solvers.is_usable(first)
            self.alternatives.follow(first.plan if usable else None, first.cost)
            self._solved_last = comparison.choice.outcome if comparison else first
        objection = partial(self._objection, x0, guess, sliding)
        decision = self.fallback.decide(first, shifted, sliding, objection)
        return decision, Attempt(
            problem=problem,
            solution=first,
            plan=decision.plan,
            warm=warm,
            prepare_s=prepare_s,
            plan_age=self.fallback.plan_age,
            failures=self.fallback.failures,
            candidates=comparison,
            refreshes=refreshes,
        )

    def guess_from_law(self, x0: State, scene: Scene) -> Plan:
        """Return the plan that the recovery law drives from `x0` in the prediction model."""
        params, car = self.prediction.params, self.prediction.car
        law = partial(recovery.target_along_path, path=scene.path, car=car, params=params)
        return initial_guess.guess_from_law(
            law, self.prediction.step, car, x0, params.model.horizon, params.model.step_s
        )

    def prepare(self, scene: Scene) -> Solution | None:
        """Solve the problem expected at the next tick; its plan becomes the guess there.

        The expected state is that of the plan, `scene` that of the next tick. Returns the
        solution; None without a plan, and after a failure.
        """
        plan = self.fallback.plan
        self.prepared = None
        if plan is None or self.fallback.failures:
            return None
        x0 = State(*plan.X[1])
        guess = self.prediction.shift_to(plan, x0)
        solution = self.solvers.solve_ahead(self.prediction.build_problem(x0, scene, guess))
        if self.solvers.is_usable(solution):
            self.prepared = solution.plan
        return solution

    def explore(self) -> list[Outcome]:
        """Solve the new guesses that the last tick put off until its command was sent.

        From the state and scene of that tick; usable plans compete at the next one. Returns what
        came of them.
        """
        postponed = self.alternatives.take_postponed() if self.alternatives else []
        if not postponed:
            return []
        last, began = self.last_problem, self.clock()
        problems = self._build_others(last.x0, last.scene, postponed, began)
        outcomes = self._judge(problems, self.solvers.solve_candidates([*problems.values()], began))
        driven = self._solved_last
        if isinstance(driven, Solution):
            (driven,) = self._judge({FOLLOWED: last}, [driven])
        self.alternatives.keep_explored(driven, outcomes)
        return outcomes

    def brake(self, reason: str, sliding: bool = False) -> Decision:
        """Return the decision to brake, or to recover a sliding car, without solving."""
        self._forget_alternatives()
        return self.fallback.brake(reason, sliding)

    def continue_plan(self, reason: str, ticks: int = 1) -> Decision:
        """Return the decision for a tick with an unknown state: the plan goes on as planned.

        `ticks` have passed since the last command.
        """
        self._forget_alternatives()
        most = self.fallback.params.max_plan_age + 1  # then it brakes, however many there were
        for _ in range(min(max(ticks, 1), most)):
            plan = self.fallback.plan
            if plan is not None:
                plan = shift(plan, self.prediction.step, self.prediction.car)
                self.progress.skip_tick()
            decision = self.fallback.follow_shifted(reason, plan)
        return decision

    def discard_plan(self) -> None:
        """Drop every plan: the gate rejected a command of it."""
        self._forget_alternatives()
        self.fallback.discard_plan()

    @property
    def guiding_plan(self) -> Plan | None:
        """The last good plan while it is recent enough to steer along."""
        return self.fallback.guiding_plan

    def _shifted_plan(self, x0: State) -> Plan | None:
        plan = self.fallback.plan
        return None if plan is None else self.prediction.shift_to(plan, x0)

    def _guess(self, x0: State, scene: Scene, shifted: Plan | None) -> Plan:
        """Return the initial guess of a car that does not slide: the last plan, or the path."""
        if not self.fallback.is_warm:
            model, car = self.prediction.params.model, self.prediction.car
            return initial_guess.guess_from_path(scene.path, x0, car, model.horizon, model.step_s)
        if self.fallback.failures:
            return shifted._replace(multipliers=None)  # the solver failed from them
        return shifted

    def _take_guess(self, problem: TickProblem) -> Plan:
        """Return the initial guess: the plan that was prepared for this tick if there is one.

        The stage parameters stay those around the shifted plan, so that preparation changes the
        way to the solution and not the problem.
        """
        prepared, self.prepared = self.prepared, None
        if prepared is None or problem.guess_map.multipliers is None:
            return problem.guess_local
        guess = initial_guess.start_at(prepared, problem.x0)
        return self.prediction.formulation.to_local(guess, problem.scene.path)

    def _build_others(
        self, x0: State, scene: Scene, proposed: list[Candidate], began: float
    ) -> dict[str, TickProblem]:
        """Return the problems of candidates by name, in the order of `proposed`.

        With a time limit those for which there is no time are dropped.
        """
        built: dict[str, TickProblem] = {}
        for candidate in _in_order_of_building(proposed):
            late_s = BUILDING_SHARE * self.prediction.params.solver.time_limit_s
            if self.limit_time and self.clock() - began > late_s:
                break
            built[candidate.name] = self.prediction.build_problem(x0, scene, candidate.guess)
        return {c.name: built[c.name] for c in proposed if c.name in built}

    def _compare(
        self, followed: TickProblem, others: dict[str, TickProblem], began: float
    ) -> Comparison:
        """Return the solutions of the followed plan and the other candidates, and the choice."""
        solving = self.clock()
        problems = {FOLLOWED: followed, **others}
        solutions = self.solvers.solve_beside(
            followed, self._take_guess(followed), [*others.values()], began
        )
        solve_s = self.clock() - solving
        return Comparison(self.alternatives.choose(self._judge(problems, solutions)), solve_s)

    def _judge(
        self, problems: dict[str, TickProblem], solutions: Sequence[Solution]
    ) -> list[Outcome]:
        """Return the outcomes of solved candidates."""
        rules = self.prediction.params.fallback
        return [
            self.alternatives.judge(
                name, problem, solution, fallback.rejection_reason(solution, rules)
            )
            for (name, problem), solution in zip(problems.items(), solutions, strict=True)
        ]

    def _objection(self, x0: State, guess: Plan, sliding: bool, plan: Plan) -> str:
        """Return why a plan must not be followed although it was solved, or ''."""
        if not self.alternatives or sliding:
            return ''
        return PLAN_TOUCHES if self.alternatives.is_braking_better(plan, x0, guess) else ''

    def _forget_alternatives(self) -> None:
        """Drop the plans kept for this tick: without a solve they grow older."""
        if self.alternatives:
            self.alternatives.reset()


def _in_order_of_building(proposed: list[Candidate]) -> tuple[Candidate, ...]:
    """Return the candidates in the order in which the time for building them is spent.

    The first way around the obstacles comes first, then the plan that brakes, then the other ways.
    """
    return (*proposed[:1], *sorted(proposed[1:], key=lambda c: c.name != BRAKE))
