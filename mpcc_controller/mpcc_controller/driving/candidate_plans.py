"""The candidates of successive ticks: guesses of this one, plans kept for the next. SI units."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving import candidate_guesses, hazards, obstacle_passing, side_profiles
from mpcc_controller.driving.candidate_choice import (
    CONTACT_M,
    CandidateChooser,
    Choice,
    Outcome,
    regaining_cost,
)
from mpcc_controller.driving.candidate_guesses import BRAKE, FOLLOWED, Candidate
from mpcc_controller.driving.hazards import RoadAhead
from mpcc_controller.driving.obstacle_passing import BEHIND, Sides, are_opposed, is_same_way
from mpcc_controller.driving.prediction_model import PredictionModel, TickProblem
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.problem.stage_parameters import Scene
from node_runtime.parameters import ParameterError
from stage_solver.solution import Solution
from stage_solver.stage_problem import Plan

SURPRISE_M = 0.1  # by which V2O of the followed plan shrinks from one tick to the next
BRAKING_SHARE = 0.25  # of the cost of the braking guess, what a gentler one costs at least
# share of a plan's contact speed below which braking is better: a plan that only brushes an
# obstacle may still find its way past it, one that leads through it will not
MUCH_SLOWER = 0.5
THROUGH_M = 0.5  # overlap of such a plan
MOST_DOUBLINGS = 2
# parameters of `candidates` that recordings may not have
OPTIONAL = ('regain_speed', 'explore_after_command')
# a plan that costs so many times as much as the driven one is solved in every third tick only
DEAR, RESTS = 1.5, 2
NEW_GUESSES = 2  # per tick: they take the most iterations, and on two cores others would wait
MOST_NAMES = 64  # whose useless attempts are counted, the last ones


class Kept(NamedTuple):
    """A solved plan that was not driven."""

    name: str
    sides: Sides
    plan: Plan  # with its multipliers
    rests: int = 0  # ticks in which it is not solved, only shifted


class CandidatePlans:
    """Proposes the candidates of a tick, chooses among their solutions, keeps the others.

    A plan that was solved in the last tick converges in a few iterations: the best of each way
    around the obstacles is the guess of the next tick. A new guess that led nowhere new is tried
    again after `candidates.retry_ticks`, twice as many after each further attempt (at most
    MOST_DOUBLINGS times), or at once when the followed plan becomes useless.

    With `candidates.explore_after_command` a tick whose followed plan is good compares kept plans
    only. Its new guesses, which take the most iterations, are solved when the command is sent
    (`take_postponed`, `keep_explored`), and compete at the next tick.
    """

    def __init__(self, prediction: PredictionModel):
        """Raise ParameterError where parameters of `candidates` are missing."""
        self.prediction = prediction
        for name, value in vars(self.params.candidates).items():
            if value is None and name not in OPTIONAL:
                raise ParameterError(
                    f'candidates.{name}: is missing, and candidates.most is above 1; '
                    'allowed to be left out with candidates.most 1'
                )
        self.chooser = CandidateChooser(self.params.candidates)
        self.reset()

    @property
    def params(self) -> ControllerParams:
        """The present parameters."""
        return self.prediction.params

    def reset(self) -> None:
        """Forget the plans and switches of earlier ticks."""
        self.chooser.reset()
        self.around: RoadAhead | None = None
        self._scene: Scene | None = None
        self._kept: list[Kept] = []
        self._postponed: list[Candidate] = []
        self._forget_waits()
        self._cost = np.inf  # of the followed plan in the last tick
        self._gap = np.inf  # m, its least V2O

    def propose(self, x0: State, scene: Scene, guess: Plan) -> list[Candidate]:
        """Return the candidates besides `guess`, the one of the followed plan; most wanted first.

        There are none without danger.
        """
        self._postponed = []
        is_urgent = guess.multipliers is None or self._cost == np.inf or self._gap < CONTACT_M
        kept = [k._replace(plan=self.prediction.shift_to(k.plan, x0)) for k in self._kept]
        lines = [guess.X, *(k.plan.X for k in kept)]
        around = hazards.road_ahead(scene, x0, lines, self.prediction.car, self.params)
        self.around, self._scene = around, scene
        if around is None:
            self._kept = []
            self._forget_waits()
            return []
        # the last stage is new: nothing was planned there
        now = self._least_gap(guess.X[:-1])
        if now < self._gap - SURPRISE_M:
            self._cost = np.inf
            self._forget_waits()
            kept = [k._replace(rests=0) for k in kept]
        self._kept = [k._replace(rests=k.rests - 1) for k in kept if k.rests]
        self._waits = {name: ticks - 1 for name, ticks in self._waits.items() if ticks > 1}
        room = self.params.candidates.most - 1
        followed = self.sides_of(guess)
        beside = self._around_sides(around, x0, followed, kept)
        brake = self._braking(around, x0, guess, kept)
        candidates = _few_new(beside[: room - len(brake)] + brake)
        if is_urgent or now < CONTACT_M or not self.params.candidates.explore_after_command:
            return candidates
        self._postponed = [c for c in candidates if _is_new(c)]
        return [c for c in candidates if not _is_new(c)]

    def take_postponed(self) -> list[Candidate]:
        """Return the new guesses of the last tick that were not compared in it, once."""
        postponed, self._postponed = self._postponed, []
        return postponed

    def keep_explored(self, driven: Outcome, explored: list[Outcome]) -> None:
        """Keep the plans of ways for which there is none, after the command of the tick."""
        self._kept = self._with_new_ways(self._kept, driven, explored)

    def sides_of(self, plan: Plan) -> Sides:
        """Return the sides on which a plan passes the dangerous obstacles."""
        if self.around is None:
            return {}
        obstacles = [hazard.obstacle for hazard in self.around.hazards]
        return obstacle_passing.passed_sides(plan.X, self._scene, obstacles, self.params)

    def judge(self, name: str, problem: TickProblem, solution: Solution, rejection: str) -> Outcome:
        """Return the outcome of a solved candidate; its solution is in the map."""
        if rejection or self.around is None:
            return Outcome(name, problem, solution, rejection, {}, np.inf, 0.0)
        plan = solution.plan
        gap = self._least_gap(plan.X)
        off_road = float(np.max(plan.U[:, 3]))
        speed = self._contact_speed(plan.X) if gap < 0 else 0.0
        later = 0.0
        if self.params.candidates.regain_speed:
            later = regaining_cost(plan.X, self._scene, self.prediction.car, self.params)
        sides = self.sides_of(plan)
        return Outcome(name, problem, solution, '', sides, gap, off_road, speed, later)

    def choose(self, outcomes: list[Outcome]) -> Choice:
        """Return which outcome is driven, the first being the followed plan; keep the others."""
        known = self.around.hazards if self.around else ()
        path_sides = {h.obstacle.id: h.path_side for h in known if h.path_side != BEHIND}
        choice = self.chooser.choose(outcomes, path_sides)
        self._keep(choice)
        return choice

    def follow(self, plan: Plan | None, cost: float) -> None:
        """Remember what the followed plan costs; None if none is followed."""
        self._cost, self._gap = np.inf, np.inf
        if plan is not None and self._scene.obstacles.items:
            self._gap = self._least_gap(plan.X)
            self._cost = cost
            if self._gap < CONTACT_M:
                self._forget_waits()
                self._kept = [k._replace(rests=0) for k in self._kept]

    def is_braking_better(self, plan: Plan, x0: State, guess: Plan) -> bool:
        """Return whether a plan runs into an obstacle that braking to a stop does not, or slower.

        Braking is along `guess`. A plan cannot stop: its least speed is `limits.least_speed_mps`.
        """
        if self.around is None:
            return False
        planned = self._contact_speed(plan.X)
        if planned == 0:
            return False
        stop = candidate_guesses.braking_guess(
            guess.X, x0, self.prediction.car, self.params, floor=0.0
        )
        braked = self._contact_speed(stop.X)
        overlap = -self._least_gap(plan.X)
        # a plan through an obstacle goes on there: braking is better even at the same speed
        return braked <= (planned if overlap > THROUGH_M else MUCH_SLOWER * planned)

    def _least_gap(self, X: np.ndarray) -> float:
        return float(np.min(obstacle_passing.least_gaps(X, self._scene, self.params)))

    def _contact_speed(self, X: np.ndarray) -> float:
        return obstacle_passing.contact_speed(X, self._scene, self.params)

    def _around_sides(self, around, x0, followed, kept) -> list[Candidate]:
        """Return candidates for the ways around the hazards that the followed plan does not go."""
        proposed = []
        for sides, shape in side_profiles.side_combinations(around, x0, self.params):
            if shape.least_cost > self._cost:
                continue
            if is_same_way(sides, {key: followed.get(key, BEHIND) for key in sides}):
                continue
            name = obstacle_passing.name_of(sides)
            solved = [k for k in kept if _agrees(k.sides, sides)]
            if solved and not solved[0].rests:
                proposed.append(Candidate(name, solved[0].plan))
            elif solved:
                continue
            elif name not in self._waits:
                guess = candidate_guesses.guess_along(
                    around, shape, x0, self.prediction.car, self.params
                )
                proposed.append(Candidate(name, guess))
        return proposed

    def _braking(self, around, x0, guess, kept) -> list[Candidate]:
        solved = [k for k in kept if k.name == BRAKE]
        if solved:
            return [Candidate(BRAKE, solved[0].plan)] if not solved[0].rests else []
        if BRAKE in self._waits:
            return []
        plan = candidate_guesses.braking_guess(guess.X, x0, self.prediction.car, self.params)
        # the cheapest braking plan brakes less hard
        if BRAKING_SHARE * candidate_guesses.braking_cost(plan, around, self.params) > self._cost:
            return []
        return [Candidate(BRAKE, plan)]

    def _forget_waits(self):
        self._waits: dict[str, int] = {}  # ticks until a name is tried again
        self._attempts: dict[str, int] = {}  # useless ones of a name

    def _wait(self, name):
        attempts = self._attempts.pop(name, 0)
        self._waits[name] = self.params.candidates.retry_ticks * 2 ** min(attempts, MOST_DOUBLINGS)
        self._attempts[name] = attempts + 1  # the newest one is the last
        if len(self._attempts) > MOST_NAMES:
            del self._attempts[next(iter(self._attempts))]

    def _keep(self, choice):
        """Keep the best plan of every way that is not the driven one; let the other names wait.

        Plans that rested in this tick are kept where there is none of their way.
        """
        driven, resting = choice.outcome, self._kept
        kept = self._with_new_ways([], driven, choice.outcomes)
        for other in resting:
            if not any(is_same_way(other.sides, plan.sides) for plan in (driven, *kept)):
                kept.append(other if driven.is_clean else other._replace(rests=0))
        self._kept = kept
        if not driven.is_clean:
            self._forget_waits()

    def _with_new_ways(
        self, kept: list[Kept], driven: Outcome, outcomes: Sequence[Outcome]
    ) -> list[Kept]:
        """Return kept plans and those of the outcomes that go another way, the cheapest first.

        The names of the other outcomes wait.
        """
        kept = list(kept)
        dear = DEAR * driven.whole_cost
        usable_first = sorted(outcomes, key=lambda o: o.whole_cost if o.is_usable else np.inf)
        for outcome in usable_first:
            is_driven = outcome is driven
            is_new = outcome.is_usable and not any(
                is_same_way(outcome.sides, other.sides) for other in (driven, *kept)
            )
            if is_new:
                is_brake = outcome.name == BRAKE
                name = BRAKE if is_brake else obstacle_passing.name_of(outcome.sides)
                rests = RESTS if driven.is_clean and outcome.whole_cost > dear else 0
                kept.append(Kept(name, outcome.sides, outcome.solution.plan, rests))
            elif not is_driven and outcome.name != FOLLOWED:
                self._wait(outcome.name)
        return kept


def _few_new(candidates: list[Candidate]) -> list[Candidate]:
    """Return the candidates without the ways beyond NEW_GUESSES that were never solved.

    Those wait for the next tick. The plan that brakes stays.
    """
    new = [c for c in candidates if _is_new(c)]
    ways = [c for c in new if c.name != BRAKE]
    late = ways[max(NEW_GUESSES - (len(new) - len(ways)), 0) :]
    return [c for c in candidates if not any(c is other for other in late)]


def _is_new(candidate: Candidate) -> bool:
    """Return whether a guess is none of a solved plan."""
    return candidate.guess.multipliers is None


def _agrees(sides: Sides, wanted: Sides) -> bool:
    """Return whether a plan passes some obstacle as wanted, and none on the other side."""
    passes = any(sides.get(key, BEHIND) == side for key, side in wanted.items())
    return passes and not are_opposed(sides, wanted)
