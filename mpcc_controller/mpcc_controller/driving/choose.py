"""Which plans a tick compares around obstacles, and which of them is driven. SI units.

A plan that was solved in the last tick converges in a few iterations: the best of each way around
the obstacles is the guess of the next tick. A new guess that led nowhere new is tried again after
`candidates.retry_ticks`, twice as many after each further attempt (at most MOST_DOUBLINGS times),
or at once when the followed plan becomes useless.

With `candidates.explore_after_command` a tick whose followed plan is good compares kept plans only.
Its new guesses, which take the most iterations, are solved when the command is sent, and compete at
the next tick.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving import guesses, ways
from mpcc_controller.driving.braking import max_acceleration
from mpcc_controller.driving.fallback import rejection_reason
from mpcc_controller.driving.prediction_model import PredictionModel, TickProblem
from mpcc_controller.driving.ways import BEHIND, RoadAhead, Sides, are_opposed, is_same_way
from mpcc_controller.model.single_track import Car, Input, State
from mpcc_controller.parameters import Candidates, ControllerParams
from mpcc_controller.path import reference_path
from mpcc_controller.problem.stage_parameters import Scene
from stage_solver.solution import Solution
from stage_solver.stage_problem import Plan

FOLLOWED, BRAKE = 'followed', 'brake'
CONTACT_M = 0.0  # a plan whose circles come nearer than this touches
STILL_CLEAR_M = 0.02  # by which the circles of the followed plan may overlap: noise moves them
SPEED_STEP_MPS = 2.0  # contact speeds that differ by less count as equal
OFF_ROAD_M = 0.05  # a circle at the CoG may be so far off the road: the constraint is soft
SURPRISE_M = 0.1  # by which V2O of the followed plan shrinks from one tick to the next
BRAKING_SHARE = 0.25  # of the cost of the braking guess, what a gentler one costs at least
# share of a plan's contact speed below which braking is better: a plan that only brushes an
# obstacle may still find its way past it, one that leads through it will not
MUCH_SLOWER = 0.5
THROUGH_M = 0.5  # overlap of such a plan
MOST_DOUBLINGS = 2
# a plan that costs so many times as much as the driven one is solved in every third tick only
DEAR, RESTS = 1.5, 2
NEW_GUESSES = 2  # per tick: they take the most iterations, and on two cores others would wait
MOST_NAMES = 64  # whose useless attempts are counted, the last ones
SLACK, VX, FX = Input._fields.index('slack'), *map(State._fields.index, ('vx', 'Fx'))


class Candidate(NamedTuple):
    """An initial guess, and which way around the obstacles it goes."""

    name: str  # BRAKE, or the sides
    guess: Plan  # in the map

    @property
    def is_new(self) -> bool:
        """Whether the guess is none of a solved plan."""
        return self.guess.multipliers is None


class Kept(NamedTuple):
    """A solved plan that was not driven."""

    name: str
    sides: Sides
    plan: Plan  # with its multipliers
    rests: int = 0  # ticks in which it is not solved, only shifted


class Wait(NamedTuple):
    """How long a guess that led nowhere new is not tried again."""

    ticks: int
    attempts: int  # useless ones


class Candidacy(NamedTuple):
    """What is known of other plans than the followed one, from tick to tick."""

    kept: tuple[Kept, ...] = ()
    postponed: tuple[Candidate, ...] = ()  # until the command is sent
    waits: Mapping[str, Wait] = MappingProxyType({})  # by name, the newest last
    cost: float = np.inf  # of the followed plan in the last tick
    gap: float = np.inf  # m, its least V2O
    hold: int = 0  # ticks left in which the larger share counts, after a switch

    def wake(self) -> 'Candidacy':
        """Return the same without anything that waits or rests."""
        kept = tuple(k._replace(rests=0) for k in self.kept)
        return self._replace(kept=kept, waits=MappingProxyType({}))


class Outcome(NamedTuple):
    """A solved candidate."""

    name: str
    problem: TickProblem
    solution: Solution  # in the map
    rejection: str  # why it must not be driven, '' if it may
    sides: Sides = MappingProxyType({})  # on which the plan passes the dangerous obstacles
    least_gap: float = np.inf  # m, V2O to every obstacle over the horizon
    off_road: float = 0.0  # m, by which the slack lets the circles leave the road
    contact_speed: float = 0.0  # m/s, relative, where the plan runs into an obstacle
    later: float = 0.0  # cost beyond the horizon, of taking up the desired speed again

    @property
    def whole_cost(self) -> float:
        """The cost over the horizon and beyond it."""
        return self.solution.cost + self.later

    @property
    def is_usable(self) -> bool:
        """Whether the plan may be driven."""
        return not self.rejection

    def is_clean(self, overlap: float = 0.0) -> bool:
        """Return whether it may be driven, stays on the road and touches nothing.

        But for an `overlap` [m] of circles.
        """
        touches = self.least_gap < CONTACT_M - overlap
        return self.is_usable and not touches and self.off_road <= OFF_ROAD_M


class Choice(NamedTuple):
    """The outcomes of a tick, and the one that is driven."""

    outcomes: tuple[Outcome, ...]
    chosen: int
    switched: bool  # to a plan that passes an obstacle on another side

    @property
    def outcome(self) -> Outcome:
        """The outcome that is driven."""
        return self.outcomes[self.chosen]


def propose(
    known: Candidacy, x0: State, scene: Scene, guess: Plan, car: Car, model: PredictionModel
) -> tuple[Candidacy, RoadAhead | None, list[Candidate]]:
    """Return the road ahead and the candidates besides `guess`, that of the followed plan.

    The most wanted ones come first; there are none without danger.
    """
    params = model.params
    is_urgent = guess.multipliers is None or known.cost == np.inf or known.gap < CONTACT_M
    kept = tuple(k._replace(plan=model.shift_to(k.plan, x0, car)) for k in known.kept)
    lines = [guess.X, *(k.plan.X for k in kept)]
    around = ways.road_ahead(scene, x0, lines, car, params)
    if around is None:
        quiet = known._replace(kept=(), postponed=(), waits=MappingProxyType({}))
        return quiet, None, []
    known = known._replace(kept=kept, postponed=())
    # the last stage is new: nothing was planned there
    now = float(np.min(ways.gaps(guess.X, scene, params)[:, :-1]))
    if now < known.gap - SURPRISE_M:
        known = known.wake()._replace(cost=np.inf)
    kept = known.kept
    known = known._replace(
        kept=tuple(k._replace(rests=k.rests - 1) for k in kept if k.rests),
        waits={n: w._replace(ticks=max(w.ticks - 1, 0)) for n, w in known.waits.items()},
    )
    waiting = {name for name, wait in known.waits.items() if wait.ticks}

    def agrees(sides, wanted):
        """Return whether a plan passes some obstacle as wanted, and none on the other side."""
        passes = any(sides.get(key, BEHIND) == side for key, side in wanted.items())
        return passes and not are_opposed(sides, wanted)

    def candidates_of(name, solved, guess):
        """Return the kept plan of a way, else a guess of it; none while it rests or waits."""
        if solved is not None:
            return [] if solved.rests else [Candidate(name, solved.plan)]
        plan = None if name in waiting else guess()
        return [] if plan is None else [Candidate(name, plan)]

    followed = ways.passed_sides(guess.X, scene, around.rows, params)
    beside: list[Candidate] = []
    for sides, shape in ways.side_combinations(around, x0, params):
        passed = {key: followed.get(key, BEHIND) for key in sides}
        if shape.least_cost > known.cost or is_same_way(sides, passed):
            continue
        name = ways.name_of(sides)
        solved = next((k for k in kept if agrees(k.sides, sides) or k.name == name), None)
        along = partial(guesses.along_profile, around, shape, x0, car, params)
        beside += candidates_of(name, solved, along)

    def braking():
        plan = guesses.braking(guess.X, x0, car, params)
        # of the speed that it loses; the cheapest braking plan brakes less hard
        lost = np.maximum(np.minimum(around.vx, around.v_ref) - plan.X[:, VX], 0)
        cost = float(np.sum((lost / params.tolerances.velocity_mps) ** 2))
        return plan if BRAKING_SHARE * cost <= known.cost else None

    brake = candidates_of(BRAKE, next((k for k in kept if k.name == BRAKE), None), braking)
    room = params.candidates.most - 1 - len(brake)
    candidates = few_new(beside[:room] + brake)
    if is_urgent or now < CONTACT_M or not params.candidates.explore_after_command:
        return known, around, candidates
    known = known._replace(postponed=tuple(c for c in candidates if c.is_new))
    return known, around, [c for c in candidates if not c.is_new]


def few_new(candidates: list[Candidate]) -> list[Candidate]:
    """Return the candidates without the ways beyond NEW_GUESSES that were never solved.

    Those wait for the next tick. The plan that brakes stays.
    """
    new = [c for c in candidates if c.is_new]
    beside = [c for c in new if c.name != BRAKE]
    late = beside[max(NEW_GUESSES - (len(new) - len(beside)), 0) :]
    return [c for c in candidates if not any(c is other for other in late)]


def judge(
    problems: Mapping[str, TickProblem],
    solutions: Sequence[Solution],
    around: RoadAhead | None,
    params: ControllerParams,
) -> list[Outcome]:
    """Return the outcomes of solved candidates by name; the solutions are in the map."""
    outcomes = []
    for (name, problem), solution in zip(problems.items(), solutions, strict=True):
        rejection = rejection_reason(solution, params.fallback)
        outcome = Outcome(name, problem, solution, rejection)
        if not rejection and around is not None:
            X, U, scene, regained = (
                *solution.plan[:2],
                problem.scene,
                params.candidates.regain_speed,
            )
            gap = _least_gap(X, scene, params)
            outcome = outcome._replace(
                sides=ways.passed_sides(X, scene, around.rows, params),
                least_gap=gap,
                off_road=float(np.max(U[:, SLACK])),
                contact_speed=ways.contact_speed(X, scene, params) if gap < 0 else 0.0,
                later=regaining_cost(X, scene, problem.car, params) if regained else 0.0,
            )
        outcomes.append(outcome)
    return outcomes


def choose(
    outcomes: Sequence[Outcome], path_sides: Sides, hold: int, params: Candidates
) -> tuple[Choice, int]:
    """Return the choice, and how many ticks the larger share counts from now on.

    The cheapest plan is chosen; another one than the followed, the first outcome, must be cheaper
    by a share, which is larger for some ticks after a switch. Plans that touch an obstacle or leave
    the road lose against those that do not, and of plans that run into an obstacle the slower ones
    win. A followed plan that cannot be driven, or is not clean, is left at once for one that is
    better. `path_sides` are the sides on which the coarse path passes obstacles.
    """
    hold = max(hold - 1, 0)
    share = params.hold_share if hold else params.switch_share

    def cost_of(outcome):
        cost = outcome.whole_cost
        if not np.isfinite(cost):
            return np.inf
        return cost * (1 + params.path_share) if are_opposed(outcome.sides, path_sides) else cost

    costs = [cost_of(outcome) for outcome in outcomes]
    clean = [o.is_clean(0.0 if i else STILL_CLEAR_M) for i, o in enumerate(outcomes)]
    # plans that touch: the slower ones first, in steps of SPEED_STEP_MPS
    order = [
        (not o.is_usable, not is_clean, round(o.contact_speed / SPEED_STEP_MPS), cost)
        for o, is_clean, cost in zip(outcomes, clean, costs)
    ]
    best = min(range(len(outcomes)), key=order.__getitem__)
    if order[best][:3] == order[0][:3] and not costs[best] < (1 - share) * costs[0]:
        best = 0
    switched = are_opposed(outcomes[0].sides, outcomes[best].sides)
    return Choice(tuple(outcomes), best, switched), params.hold_ticks if switched else hold


def keep(known: Candidacy, choice: Choice, params: Candidates) -> Candidacy:
    """Keep the best plan of every way that is not the driven one; let the other names wait.

    Plans that rested in this tick are kept where there is none of their way.
    """
    driven, resting = choice.outcome, known.kept
    known = keep_new_ways(known._replace(kept=()), driven, choice.outcomes, params)
    kept = known.kept
    for other in resting:
        if not any(is_same_way(other.sides, plan.sides) for plan in (driven, *kept)):
            kept = (*kept, other if driven.is_clean() else other._replace(rests=0))
    waits = known.waits if driven.is_clean() else MappingProxyType({})
    return known._replace(kept=kept, waits=waits)


def keep_new_ways(
    known: Candidacy, driven: Outcome, outcomes: Sequence[Outcome], params: Candidates
) -> Candidacy:
    """Keep the plans of outcomes that go another way, the cheapest first; other names wait."""
    kept, waits = known.kept, dict(known.waits)
    dear = DEAR * driven.whole_cost
    # behind one far ahead plans of both sides are of one way: none of them has passed it yet
    cheap = (1 - params.switch_share) * driven.whole_cost
    for outcome in sorted(outcomes, key=lambda o: o.whole_cost if o.is_usable else np.inf):
        is_same = any(is_same_way(outcome.sides, other.sides) for other in (driven, *kept))
        is_better = is_same and BEHIND in outcome.sides.values() and outcome.is_clean()
        is_better &= outcome.name not in (FOLLOWED, BRAKE) and outcome.whole_cost < cheap
        if outcome.is_usable and (is_better or not is_same):
            is_named = is_better or outcome.name == BRAKE
            name = outcome.name if is_named else ways.name_of(outcome.sides)
            rests = RESTS if driven.is_clean() and outcome.whole_cost > dear else 0
            kept = (*kept, Kept(name, outcome.sides, outcome.solution.plan, rests))
        elif outcome is not driven and outcome.name != FOLLOWED:
            attempts = waits.pop(outcome.name, Wait(0, 0)).attempts
            ticks = params.retry_ticks * 2 ** min(attempts, MOST_DOUBLINGS)
            waits[outcome.name] = Wait(ticks, attempts + 1)  # the newest one is the last
    return known._replace(kept=kept, waits=dict([*waits.items()][-MOST_NAMES:]))


def follow(
    known: Candidacy, plan: Plan | None, cost: float, scene: Scene, params: ControllerParams
) -> Candidacy:
    """Remember what the followed plan costs; None if none is followed."""
    if plan is None or not scene.obstacles.items:
        return known._replace(cost=np.inf, gap=np.inf)
    known = known._replace(cost=cost, gap=_least_gap(plan.X, scene, params))
    return known.wake() if known.gap < CONTACT_M else known


def is_braking_better(
    plan: Plan,
    x0: State,
    guess: Plan,
    scene: Scene,
    car: Car,
    probing: Car,
    params: ControllerParams,
) -> bool:
    """Return whether to brake to a stop along `guess` rather than drive a plan.

    It is better where a plan runs into an obstacle that braking does not, or slower: a plan cannot
    stop, its least speed is `limits.least_speed_mps`. So it is where a plan that passes nothing
    brakes with all friction of `car`, which is believed, and avoids an obstacle only by steering,
    too: the model loses speed by that, tyres do not. The car brakes with the friction of `probing`.
    """

    def contact_speed(line, with_car):
        stop = guesses.braking(line, x0, with_car, params, floor=0.0)
        return ways.contact_speed(stop.X, scene, params)

    brakes = np.min(plan.X[:, FX]) <= -car.m * max_acceleration(car, params.limits)
    every = range(len(scene.obstacles.items))
    if brakes and not any(ways.passed_sides(plan.X, scene, every, params).values()):
        # twice the horizon: until it stands; who moves stays where its course ends
        line = np.vstack((guess.X, np.repeat(guess.X[-1:], len(guess.X), axis=0)))
        if contact_speed(line, probing) < MUCH_SLOWER * contact_speed(line, car):
            return True
    planned = ways.contact_speed(plan.X, scene, params)
    if planned == 0:
        return False
    braked, overlap = contact_speed(guess.X, car), -_least_gap(plan.X, scene, params)
    # a plan through an obstacle goes on there: braking is better even at the same speed
    return braked <= (planned if overlap > THROUGH_M else MUCH_SLOWER * planned)


def regaining_cost(X: np.ndarray, scene: Scene, car: Car, params: ControllerParams) -> float:
    """Return what the velocity will cost after planned states (N + 1, 9), until it is desired.

    With the largest driving force from the last speed, the sum of the squared errors is about

        integral of (v_ref - v)^2 dt = (v_ref - v_N)^3 / (3 F / m).

    Within the horizon a plan that waits before an obstacle may be as cheap as one that passes it,
    and cheaper still at the next tick: it has what passing costs yet to pay. A car that cannot
    drive regains nothing, whatever the plan: 0.
    """
    if not params.limits.drive_n:
        return 0.0
    end = State(*X[-1])
    _, v_ref = reference_path.arcs_at(scene.path, np.array([end.theta]))
    lacking = max(float(v_ref[0]) - end.vx, 0.0)
    squares = lacking**3 / (3 * params.limits.drive_n / car.m) / params.model.step_s
    return squares / params.tolerances.velocity_mps**2


def _least_gap(X: np.ndarray, scene: Scene, params: ControllerParams) -> float:
    return float(np.min(ways.least_gaps(X, scene, params)))
