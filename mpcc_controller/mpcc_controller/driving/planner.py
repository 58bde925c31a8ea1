"""One plan per tick: projection, initial guess, stage parameters, bounds, solvers. SI units."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from mpcc_controller import run_time_parameters
from mpcc_controller.driving import fallback, initial_guess, recovery, solver_selection
from mpcc_controller.driving.braking import Point
from mpcc_controller.driving.candidate_choice import Choice, Outcome
from mpcc_controller.driving.candidate_plans import CandidatePlans
from mpcc_controller.driving.candidates import BRAKE, FOLLOWED, Candidate
from mpcc_controller.driving.fallback import Decision, FallbackLogic
from mpcc_controller.driving.parallel_solves import ParallelSolves
from mpcc_controller.driving.setpoints import Setpoints, SetpointTarget
from mpcc_controller.driving.tick_problem import TickProblem
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, State
from mpcc_controller.parameters import INTEGRATED, REFRESHED, CarParams, ControllerParams
from mpcc_controller.path import compiled_queries, reference_path
from mpcc_controller.problem import bounds, cost_terms, formulation, ocp, stage_parameters
from mpcc_controller.problem.plan_evaluator import PlanEvaluator
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.conversions import add_seconds, ns_to_s
from msgs_yaml.types import VehicleState
from stage_solver.buffered_function import BufferedFunction
from stage_solver.solution import FAILED, ONE_STEP, STOPPED_EARLY, Solution, StageSolver
from stage_solver.solver import make_solver
from stage_solver.stage_problem import Plan, shift

BRAKING_PROBE = 1.15  # friction that braking uses over the one that is believed
PLAN_TOUCHES = 'plan_touches'  # an obstacle before which the car can stop
LOST_M = 5.0  # from the projection, beyond it an integrated theta starts from there again
# of theta between a plan and the guess around which its arcs were taken: over less an arc of the
# double lane change (curvature changing by 0.01 1/m^2) is off by less than a millimetre
REFRESH_FROM_M = 0.5
MOST_REFRESHES = 3  # per tick
RELAXATION = 1e4  # of the weights of soft limits: tolerances 100 times as large
RELAXED = 'stuck; the plan is that of relaxed soft limits'
BUILDING_SHARE = 0.25  # of `solver.time_limit_s` in which the problems of candidates are built


class Comparison(NamedTuple):
    """The candidates of one tick. `first` and `problem` of the attempt are those of the chosen."""

    choice: Choice
    solve_s: float  # s, wall time of all solves


class Attempt(NamedTuple):
    """The solutions of one tick."""

    problem: TickProblem
    first: Solution
    second: Solution | None  # None if the second solver did not run
    plan: Plan | None  # the plan that the fallback logic chose
    warm: bool  # whether the guess was the last plan
    prepare_s: float  # s, to build the problem
    plan_age: int  # ticks
    failures: int  # of the first solver, in a row
    candidates: Comparison | None = None  # where several plans were compared
    refreshes: int | None = None  # solves with arcs taken again; None where that is off


class Planner:
    """Solves the problem once per tick; carries plan and path distance over to the next tick.

    Plans are in the map here, whatever the states of the formulation are.
    """

    def __init__(
        self,
        params: ControllerParams,
        vehicle: CarParams,
        limit_time: bool,
        clock: Callable[[], float],
    ):
        """`limit_time` lets the solvers stop at their wall-time limits; `clock` is in s."""
        self._vehicle = vehicle
        self.params = params = run_time_parameters.in_force(params, vehicle)
        self.car = self._nominal_car = stage_parameters.car(params, vehicle)
        self.friction = params.model.friction  # believed, that of `car`
        self.limit_time = limit_time
        self.clock = clock
        self.formulation = formulation.make(params, self.car)
        compiled_queries.library()  # compiled now, not when the first path is set
        symbolic = self.formulation.ocp
        self.problem = ocp.build(symbolic, params.model.horizon, params.model.step_s)
        self.first_solver = make_solver(
            self.problem, solver_selection.first_solver_options(params, limit_time)
        )
        self.second_solver = solver_selection.make_second_solver(
            params, self.problem, limit_time, self.first_solver
        )
        self.sliding_solver = None
        if params.fallback.recovery:
            options = solver_selection.sliding_options(params, limit_time)
            self.sliding_solver = make_solver(self.problem, options)
            limits = {f'weights.{name}' for name in cost_terms.SOFT_LIMITS}
            self._soft_limits = [  # their columns in the stage parameters
                i for i, name in enumerate(self.problem.parameters) if name in limits
            ]
        self.evaluator = PlanEvaluator(symbolic)
        self._step = BufferedFunction(single_track.step(params.model.step_s, type(self.car)))
        self.alternatives: CandidatePlans | None = None
        if (params.candidates.most or 1) > 1:
            self.alternatives = CandidatePlans(params, self.car, self.step)
            options = solver_selection.candidate_options(params, limit_time)
            self.parallel = ParallelSolves(
                lambda: make_solver(self.problem, options), params.candidates.most - 1
            )
        self.reset()

    def reset(self) -> None:
        """Drop the plan and the path distance: the next tick starts cold."""
        self._is_sliding = False  # at this tick, and to be recovered
        self.fallback = FallbackLogic(self.params.fallback)
        self.theta: float | None = None  # m, last projection on the path
        self._stage_ns = 0  # when stage 0 of the last plan was
        self.last_problem: TickProblem | None = None
        self.prepared: Plan | None = None  # solution of the problem expected next
        self._solved_last: Outcome | Solution | None = None  # what the last tick chose
        self._forget_alternatives()

    def warm_up(self) -> None:
        """Let the second solver and those of slides and candidates solve the last problem once."""
        if self.last_problem is None:
            return
        candidates = self.parallel.solvers if self.alternatives else ()
        for solver in (self.sliding_solver, self.second_solver, *candidates):
            if solver is not None:
                cold = self.last_problem.guess_local._replace(multipliers=None)
                _solve(solver, self.last_problem, cold)

    def believe(self, friction: float) -> None:
        """Plan for a road of another friction than `model.friction` from now on."""
        self.friction = friction
        self.car = stage_parameters.with_friction(self._nominal_car, friction, self.params)
        self.formulation.set_car(self.car)
        if self.alternatives:
            self.alternatives.car = self.car

    def change(self, params: ControllerParams) -> None:
        """Plan with other weights and limits from now on; see `run_time_parameters`."""
        self.params = run_time_parameters.in_force(params, self._vehicle)
        self.formulation.set_params(self.params)
        if self.alternatives:
            self.alternatives.params = self.params

    def check_effect(self, params: ControllerParams, changed: Sequence[str]) -> None:
        """Raise ParameterError for a changed parameter that would have no effect here."""
        terms = [t for t in self.formulation.rules.terms if cost_terms.is_on(t, params)]
        known = [*(t.parameter for t in terms), *(f'envelope.{t.limit}' for t in terms if t.limit)]
        run_time_parameters.check_effect(params, changed, self._vehicle, known)

    @property
    def car_to_brake(self) -> Car:
        """The car on a road of a little more friction than is believed.

        What is believed is cautious, and only forces beyond it tell whether the road has more. A
        car that brakes without a plan finds it so; where it is not there, the belief falls at once.
        """
        friction = min(BRAKING_PROBE * self.friction, self.params.model.friction)
        return stage_parameters.with_friction(self._nominal_car, friction, self.params)

    def step(self, x: np.ndarray, u: np.ndarray, car: Car) -> np.ndarray:
        """Return the state (9,) one tick after `x` (9,) under the input `u` (4,)."""
        return self._step(x=x, u=u, car=car)['x_next'].copy()

    def project(self, x: VehicleState, scene: Scene) -> float:
        """Return the distance [m] along the path of the point closest to the car."""
        reach = self.params.surroundings.path_search_m
        self.theta = reference_path.project(scene.path, x.X, x.Y, self.theta, reach)
        return self.theta

    def initial_state(self, x: VehicleState, now: Setpoints, scene: Scene) -> State:
        """Return the state of stage 0: heading within pi of the path's, theta by projection.

        With `model.theta` integrated, theta is where the last plan predicted it: the lag error of
        stage 0 is what the prediction has missed. It starts from the projection again where there
        is no last plan, after a change of the path, and beyond LOST_M from the projection.
        """
        is_new_path = self.theta is None
        theta = self.project(x, scene)
        if self.params.model.theta == INTEGRATED:
            predicted = None if is_new_path else self._predicted_theta(x.stamp_ns)
            if predicted is not None and abs(predicted - theta) <= LOST_M:
                theta = predicted
            self._stage_ns = x.stamp_ns
        arcs, _ = reference_path.arcs_at(scene.path, theta)
        turns = np.round((arcs.psi - x.psi) / (2 * np.pi))
        return State(
            X=x.X,
            Y=x.Y,
            psi=float(x.psi + 2 * np.pi * turns),
            vx=x.vx,
            vy=x.vy,
            r=x.r,
            theta=theta,
            delta=now.delta,
            Fx=now.Fx,
        )

    def _predicted_theta(self, stamp_ns: int) -> float | None:
        """Return the theta [m] of the last plan at an instant, None without a plan."""
        plan = self.fallback.plan
        if plan is None:
            return None
        model = self.params.model
        t = model.step_s * np.arange(model.horizon + 1)
        theta = plan.X[:, State._fields.index('theta')]
        return float(np.interp(ns_to_s(stamp_ns - self._stage_ns), t, theta))

    def plan(self, x0: State, scene: Scene, sliding: bool = False) -> tuple[Decision, Attempt]:
        """Return what to drive from `x0`, and the solutions that led to it.

        A car that is `sliding` is to be recovered where there is no plan, and the recovery law
        then drives the guess.
        """
        began = self.clock()
        self._is_sliding = sliding
        model = self.params.model
        shifted = self._shifted_plan(x0)
        warm = self.fallback.is_warm
        guess, from_law = shifted, False
        if sliding and (not warm or self.fallback.failures):
            guess, from_law = self.guess_from_law(x0, scene), True
        elif not warm:
            guess = initial_guess.guess_from_path(
                scene.path, x0, self.car, model.horizon, model.step_s
            )
        elif self.fallback.failures:
            guess = shifted._replace(multipliers=None)  # the solver failed from them
        problem = self.build_problem(x0, scene, guess)
        others = self.alternatives.propose(x0, scene, guess) if self.alternatives else []
        problems = self._build_others(x0, scene, others, began)
        prepare_s = self.clock() - began
        # what the paper's controller does not do is paid for by the solvers
        solving = began if self.alternatives or from_law else began + prepare_s
        comparison = None
        if problems:
            comparison = self.compare(problem, problems, solving)
            problem, first = comparison.choice.outcome.problem, comparison.choice.outcome.solution
            second = self.solve_again(problem, first, solving)
        else:
            first, second = self.solve(problem, solving)
        refreshes = None
        if self.params.surroundings.arcs == REFRESHED:
            problem, first, refreshes = self.refresh_arcs(problem, first, solving)
        self.last_problem = problem
        if self.alternatives:
            usable = not fallback.rejection_reason(first, self.params.fallback)
            self.alternatives.follow(first.plan if usable else None, first.cost)
            self._solved_last = comparison.choice.outcome if comparison else first

        def objection(plan: Plan) -> str:
            checks = self.alternatives and not sliding
            touches = checks and self.alternatives.is_braking_better(plan, x0, guess)
            return PLAN_TOUCHES if touches else ''

        decision = self.fallback.decide(first, second, shifted, sliding, objection)
        age, failures = self.fallback.plan_age, self.fallback.failures
        return decision, Attempt(
            problem,
            first,
            second,
            decision.plan,
            warm,
            prepare_s,
            age,
            failures,
            comparison,
            refreshes,
        )

    def guess_from_law(self, x0: State, scene: Scene) -> Plan:
        """Return the plan that the recovery law drives from `x0` in the prediction model."""
        params, path = self.params, scene.path

        def law(x: State) -> SetpointTarget:
            preview = max(params.braking.preview_s * x.vx, params.braking.least_preview_m)
            arcs, _ = reference_path.arcs_at(path, x.theta + preview)
            ahead = Point(float(arcs.X), float(arcs.Y))
            return recovery.recovery_target(x, Setpoints(x.delta, x.Fx), ahead, self.car, params)

        model = params.model
        return initial_guess.guess_from_law(
            law, self.step, self.car, x0, model.horizon, model.step_s
        )

    def build_problem(self, x0: State, scene: Scene, guess_map: Plan) -> TickProblem:
        """Return the problem from `x0`, its stage parameters taken around the guess."""
        model, form = self.params.model, self.formulation
        parameters = form.stage_parameters(scene, guess_map.X)
        limits = bounds.build(
            self.params.limits, self.car, x0.Fx, model.horizon, model.step_s, form.ocp.state
        )
        guess_local = form.to_local(guess_map, scene.path)
        return TickProblem(x0, scene, guess_map, guess_local, parameters, limits)

    def _build_others(
        self, x0: State, scene: Scene, others: list[Candidate], began: float
    ) -> dict[str, TickProblem]:
        """Return the problems of the other candidates by name, in the order of `others`.

        With a time limit those for which there is no time are dropped. The first way around the
        obstacles is built first, then the plan that brakes, then the other ways.
        """
        built: dict[str, TickProblem] = {}
        for candidate in (*others[:1], *sorted(others[1:], key=lambda c: c.name != BRAKE)):
            late = self.clock() - began > BUILDING_SHARE * self.params.solver.time_limit_s
            if not (self.limit_time and late):
                built[candidate.name] = self.build_problem(x0, scene, candidate.guess)
        return {c.name: built[c.name] for c in others if c.name in built}

    def solve(
        self, problem: TickProblem, began: float | None = None
    ) -> tuple[Solution, Solution | None]:
        """Return the solution of the first solver, and of the second if the first one failed.

        `began` is when their time began, by the clock; None: now.
        """
        began = self.clock() if began is None else began
        first = self._solve_first(problem, self._take_guess(problem), began)
        return first, self.solve_again(problem, first, began)

    def _solve_first(self, problem: TickProblem, guess: Plan, began: float) -> Solution:
        """Return the solution of the first solver; of a car that slides, by way of a relaxed one.

        A slide breaks every soft limit: road, distances, envelope. What that costs is larger than
        all else by orders of magnitude, and Newton's method may get stuck. Where it does, the
        problem in which it costs RELAXATION times less is solved from the same guess, and the true
        one from its plan; where that gets stuck, too, the relaxed plan may be driven: as an early
        end of the true problem, with the cost that it has there.
        """
        chosen = self._chosen_solver()
        self._limit(chosen, began)
        first = self._run(chosen, problem, guess)
        if chosen is not self.sliding_solver or self._is_usable(first):
            return first
        P = problem.parameters.P.copy()
        P[:, self._soft_limits] /= RELAXATION
        relaxed = problem._replace(parameters=problem.parameters._replace(P=P))
        self._limit(chosen, began)
        on_the_way = self._run(chosen, relaxed, guess._replace(multipliers=None))
        self._limit(chosen, began)
        start = self.formulation.to_local(on_the_way.plan, problem.scene.path)
        second = self._run(chosen, problem, start._replace(multipliers=None))
        best = first
        if self._is_usable(second):
            best = second
        elif self._is_usable(on_the_way):
            cost = self.evaluator.cost(start, problem.parameters.P)
            best = on_the_way._replace(cost=cost, status=STOPPED_EARLY, message=RELAXED)
        tried = (first, on_the_way, second)
        return best._replace(
            iterations=sum(s.iterations for s in tried),
            solve_s=sum(s.solve_s for s in tried),
            cpu_s=sum(s.cpu_s for s in tried),
        )

    def _is_usable(self, solution: Solution) -> bool:
        return not fallback.rejection_reason(solution, self.params.fallback)

    def _limit(self, chosen: StageSolver, began: float) -> None:
        """Let a solver stop where the time of its tick ends; `began` is when that began."""
        if self.limit_time and (self.alternatives or self.sliding_solver):
            remaining_s = self.params.solver.time_limit_s - (self.clock() - began)
            chosen.set_time_limit(max(remaining_s, 0.0))

    def _chosen_solver(self) -> StageSolver:
        """Return the first solver; while the car slides, the one that iterates longer."""
        return (
            self.sliding_solver if self._is_sliding and self.sliding_solver else self.first_solver
        )

    def solve_again(self, problem: TickProblem, first: Solution, began: float) -> Solution | None:
        """Return the solution of the second solver; None where `first` may be driven.

        `began` is when the first solver did, by the clock.
        """
        if not self.second_solver or not fallback.rejection_reason(first, self.params.fallback):
            return None
        if self.limit_time:
            remaining_s = self.params.solver.fallback_limit_s - (self.clock() - began)
            self.second_solver.set_time_limit(max(remaining_s, 0.0))
        cold = problem.guess_local._replace(multipliers=None)
        return self._run(self.second_solver, problem, cold)

    def refresh_arcs(
        self, problem: TickProblem, first: Solution, began: float
    ) -> tuple[TickProblem, Solution, int]:
        """Solve again, around the plan, while theta of the plan is far from that of the guess.

        Arcs of the path, edges and slots of obstacles are those around the guess. Returns the last
        problem, its solution with the time and the iterations of all, and the number of further
        solves: at most MOST_REFRESHES, none where theta moved by up to REFRESH_FROM_M. A further
        solution that may not be driven is dropped. `began` is when the first solve did.
        """
        chosen, limit_s = self._chosen_solver(), self.params.solver.time_limit_s
        refreshes = 0
        while refreshes < MOST_REFRESHES and self._has_left_arcs(problem, first):
            remaining_s = limit_s - (self.clock() - began)
            if self.limit_time and remaining_s <= 0:
                break
            if self.limit_time:
                chosen.set_time_limit(remaining_s)
            again = self.build_problem(problem.x0, problem.scene, first.plan)
            solution = self._run(chosen, again, again.guess_local)
            refreshes += 1
            spent = {
                'iterations': first.iterations + solution.iterations,
                'solve_s': first.solve_s + solution.solve_s,
                'cpu_s': first.cpu_s + solution.cpu_s,
            }
            if fallback.rejection_reason(solution, self.params.fallback):
                first = first._replace(**spent)
                break
            problem, first = again, solution._replace(**spent)
        if self.limit_time and refreshes:
            chosen.set_time_limit(limit_s)
        return problem, first, refreshes

    def _has_left_arcs(self, problem: TickProblem, solution: Solution) -> bool:
        """Return whether a plan that may be driven is far from where its arcs were taken."""
        if fallback.rejection_reason(solution, self.params.fallback):
            return False
        theta = State._fields.index('theta')
        moved = np.abs(solution.plan.X[:, theta] - problem.guess_map.X[:, theta])
        return bool(np.max(moved) > REFRESH_FROM_M)

    def compare(
        self, followed: TickProblem, others: dict[str, TickProblem], began: float | None = None
    ) -> Comparison:
        """Return the solutions of the followed plan and the other candidates, and the choice.

        They are solved in parallel; within the time limit of the solver, where there is one.
        `began` is when their time began, by the clock; None: now.
        """
        solving = self.clock()
        began = solving if began is None else began
        guess = self._take_guess(followed)
        first, outcomes = self._solve_candidates(
            others, began, lambda: self._solve_first(followed, guess, began)
        )
        solve_s = self.clock() - solving
        outcomes = [self._judge(FOLLOWED, followed, first), *outcomes]
        return Comparison(self.alternatives.choose(outcomes), solve_s)

    def _solve_candidates(
        self, problems: dict[str, TickProblem], began: float, own: Callable
    ) -> tuple[Any, list[Outcome]]:
        """Return the result of `own`, and the outcomes of candidates that are solved meanwhile."""
        jobs = [partial(self._solve_candidate, problem, began) for problem in problems.values()]
        result, solved = self.parallel.run(own, jobs)
        return result, [
            self._judge(name, problem, self._finish(solution, problem))
            for (name, problem), solution in zip(problems.items(), solved, strict=True)
        ]

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
        guess = initial_guess.shift_to(plan, self.step, self.car, x0)
        problem = self.build_problem(x0, scene, guess)
        self._limit(self.first_solver, self.clock())
        solution = self._run(self.first_solver, problem, problem.guess_local)
        if not fallback.rejection_reason(solution, self.params.fallback):
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
        outcomes = self._solve_candidates(problems, began, lambda: None)[1]
        driven = self._solved_last
        if isinstance(driven, Solution):
            driven = self._judge(FOLLOWED, last, driven)
        self.alternatives.keep_explored(driven, outcomes)
        return outcomes

    def brake(self, reason: str, sliding: bool = False) -> Decision:
        """Return the decision to brake, or to recover a sliding car, without solving."""
        self._forget_alternatives()
        return self.fallback.brake(reason, sliding)

    def continue_plan(self, reason: str) -> Decision:
        """Return the decision for a tick with an unknown state: the plan goes on as planned."""
        self._forget_alternatives()
        plan = self.fallback.plan
        if plan is not None:
            plan = shift(plan, self.step, self.car)
            self._stage_ns = add_seconds(self._stage_ns, self.params.model.step_s)
        return self.fallback.follow_shifted(reason, plan)

    def discard_plan(self) -> None:
        """Drop every plan: the gate rejected a command of it."""
        self._forget_alternatives()
        self.fallback.discard_plan()

    @property
    def guiding_plan(self) -> Plan | None:
        """The last good plan while it is recent enough to steer along."""
        return self.fallback.guiding_plan

    def _forget_alternatives(self):
        """Drop the plans kept for this tick: without a solve they grow older."""
        if self.alternatives:
            self.alternatives.reset()

    def _take_guess(self, problem: TickProblem) -> Plan:
        """Return the initial guess: the plan that was prepared for this tick if there is one.

        The stage parameters stay those around the shifted plan, so that preparation changes the
        way to the solution and not the problem.
        """
        prepared, self.prepared = self.prepared, None
        if prepared is None or problem.guess_map.multipliers is None:
            return problem.guess_local
        guess = initial_guess.start_at(prepared, problem.x0)
        return self.formulation.to_local(guess, problem.scene.path)

    def _run(self, chosen: StageSolver, problem: TickProblem, guess: Plan) -> Solution:
        """Return the solution in the map."""
        return self._finish(_solve(chosen, problem, guess), problem)

    def _solve_candidate(self, problem, began, chosen: StageSolver) -> Solution:
        """Return the solution in the states of the problem; called in any thread."""
        self._limit(chosen, began)
        return _solve(chosen, problem, problem.guess_local)

    def _judge(self, name, problem, solution) -> Outcome:
        rejection = fallback.rejection_reason(solution, self.params.fallback)
        return self.alternatives.judge(name, problem, solution, rejection)

    def _finish(self, solution, problem) -> Solution:
        """Return the solution in the map."""
        plan = self.formulation.to_map(solution.plan, problem.scene.path)
        if solution.status == ONE_STEP:  # the driven step obeys the dynamics exactly
            driven = self.step(plan.X[0], plan.U[0], self.car)
            plan = plan._replace(X=np.vstack([plan.X[:1], driven, plan.X[2:]]))
        return solution._replace(plan=plan)

    def _shifted_plan(self, x0) -> Plan | None:
        if self.fallback.plan is None:
            return None
        return initial_guess.shift_to(self.fallback.plan, self.step, self.car, x0)


def _solve(chosen: StageSolver, problem: TickProblem, guess: Plan) -> Solution:
    """Return the solution; a solver that raises has failed: the car needs a command anyway."""
    try:
        return chosen.solve(*problem.solver_arguments, guess)
    except Exception as error:
        return Solution(guess, np.nan, FAILED, str(error), 0, np.inf, np.inf, 0.0, 0.0)
