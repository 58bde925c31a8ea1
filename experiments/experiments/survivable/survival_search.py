"""Whether an emergency can be survived: a search over drives on the plant, and a bound.

`survivable` looks for a drive that survives, from the cheapest kind to the dearest:

1. an MPCC with hindsight along every approach;
2. manoeuvres around the best approaches, changed by CMA-ES.

What it finds was driven: the plant, its gate and its servos are those of every run. The search
minimises how far a trajectory is from surviving (`shortfall`: overlap with obstacles, wheels off
the road, sideslip); the metrics of the whole drive alone decide (`survives`). Without one, and
where no position remains (`bound`), it is impossible; otherwise undecided.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from cmaes import CMA
from scipy.interpolate import CubicSpline

from bags.evaluation import geometry
from bags.evaluation.drive import Drive, obstacle_tracks, outline_of
from bags.evaluation.metrics import survival
from bags.evaluation.metrics.outcome import SLIDING_DEG
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.evaluation.metrics.survival import SHOULDER_M, SLIDING_FROM_MPS
from experiments.simulation import Setup
from experiments.survivable import bound, sides
from experiments.survivable.emergency import TICK_S, Emergency, Rollout
from experiments.survivable.pilots import Foresight, Manoeuvre, Tracker
from experiments.survivable.sides import Approach
from mpcc_controller.parameters import ControllerParams
from msgs_yaml.conversions import NS_PER_S
from node_runtime import parameters
from vehicle_plant.simulator import TICK_NS
from vehicle_plant.suspension import wheel_corners

POSSIBLE, IMPOSSIBLE, UNDECIDED = 'possible', 'impossible', 'undecided'
SEARCH_VERSION = 3  # counts up where verdicts of before are no longer those of today
BUDGET = 600  # rollouts of the search, those of the MPCC included
STARTS = 3  # approaches around which manoeuvres are searched
KNOT_S, BRAKE_KNOT_S = 0.5, 0.6  # between knots of the path and of the braking
OFFSET_SCALE_M, BRAKE_SCALE = 0.5, 0.25  # of the first generation; braking relative to the grip
EFFORT = 0.01  # cost of a manoeuvre one scale away from its approach
SETTLED_GENERATIONS, SETTLED_SHARE = 7, 0.03  # without so much gain a search has settled
AFTER_S = 2.0  # a manoeuvre is judged until so long after the last obstacle was met

MARGIN_M = 0.15  # beside an obstacle, aimed at by the search
ROAD_MARGIN_M, SLIDING_MARGIN_DEG = 0.2, 5.0


class Verdict(NamedTuple):
    """Whether an emergency can be survived, and how that is known."""

    answer: str  # POSSIBLE, IMPOSSIBLE or UNDECIDED
    how: str  # for a person
    rollouts: int  # that were driven
    drive: Drive | None  # that survives, for POSSIBLE


def survivable(
    setup: Setup,
    budget: int = BUDGET,
    seed: int = 1,
    preview: bool = False,
    drivers: Sequence[ControllerParams] = (),
) -> Verdict:
    """Return whether any driver can survive the run of a setup.

    budget   rollouts after which it stays undecided
    seed     of the search; the same arguments give the same verdict
    preview  the driver may act from the start of the run; otherwise from the first instant at which
             an obstacle is present and a fault of the actuators has begun, with the car as the
             setup's controller has driven it
    drivers  MPCCs for the first stage, by default that of the setup
    """
    emergency = Emergency(setup, preview)
    empty_at = bound.impossible_at(emergency)
    if empty_at is not None:
        return Verdict(IMPOSSIBLE, f'no position is left {empty_at:.2f} s after it begins', 0, None)
    search = _Search(emergency, budget, np.random.default_rng(seed))
    for how, rollout in search.candidates(drivers or (setup.params,)):
        drive = emergency.drive(rollout)
        if survives(drive):
            return Verdict(POSSIBLE, how, search.rollouts, drive)
        if search.rollouts >= budget:
            break
    return Verdict(UNDECIDED, 'nothing found', search.rollouts, None)


class Shortfall(NamedTuple):
    """What a trajectory lacks: all zero where it keeps every margin."""

    gap: float  # m, over all obstacles the sum of what lacks to the margin
    road: float  # m
    sideslip: float  # in units of 10 deg

    @property
    def cost(self) -> float:
        """What the search minimises."""
        return 2 * self.gap + 2 * self.road + self.sideslip

    @property
    def may_survive(self) -> bool:
        """Whether the trajectory is worth the metrics of the whole drive."""
        is_on_road = self.road < ROAD_MARGIN_M
        return self.gap < MARGIN_M and is_on_road and self.sideslip < SLIDING_MARGIN_DEG / 10


class Judge:
    """Measures rollouts of one emergency; the obstacles' motion is computed once."""

    def __init__(self, emergency: Emergency):
        self._emergency = emergency
        plant = emergency.setup.plant
        self._outline = outline_of(parameters.flatten(plant))
        self._wheels = np.array([(corner.x, corner.y) for corner in wheel_corners(plant.car)])
        stamps = emergency.start_ns + TICK_NS * np.arange(emergency.most_ticks + 1)
        messages = [emergency.obstacles_at(int(stamp)) for stamp in stamps]
        self._discs = obstacle_tracks(stamps, messages)

    def shortfall(self, rollout: Rollout) -> Shortfall:
        """Return what a rollout lacks."""
        X, Y, psi, vx, vy = rollout.states()
        since = (rollout.stamps() - self._emergency.start_ns) / NS_PER_S
        gap = 0.0
        for disc in self._discs:
            k = np.minimum((since * NS_PER_S / TICK_NS).astype(int), len(disc.x) - 1)
            age = since - k * TICK_NS / NS_PER_S
            place = disc.x[k] + disc.vx[k] * age, disc.y[k] + disc.vy[k] * age
            gaps = geometry.gap_to_circle(X, Y, psi, self._outline, *place, disc.radius)
            if np.isfinite(gaps).any():  # while it is present
                gap += max(0.0, MARGIN_M - np.nanmin(gaps))
        wheels = geometry.transform_to_map(self._wheels, X[::5], Y[::5], psi[::5])
        beyond = self._emergency.course.beyond_edge(wheels[..., 0], wheels[..., 1]).max()
        moving = np.hypot(vx, vy) > SLIDING_FROM_MPS
        sideslip = np.degrees(np.abs(np.arctan2(vy, vx)))[moving].max(initial=0.0)
        return Shortfall(
            gap,
            max(0.0, beyond - SHOULDER_M + ROAD_MARGIN_M),
            max(0.0, sideslip - SLIDING_DEG + SLIDING_MARGIN_DEG) / 10,
        )


def survives(drive: Drive) -> bool:
    """Return whether a whole drive counts as survived, by the metric of that name."""
    return EvaluatedDrive(drive).value(survival.survived) is True


class _Search:
    """The rollouts of one emergency."""

    def __init__(self, emergency: Emergency, budget: int, rng: np.random.Generator):
        self.emergency, self.judge, self._rng = emergency, Judge(emergency), rng
        self._budget, self.rollouts = budget, 0

    def _roll(self, pilot, ticks=None) -> tuple[Rollout, Shortfall]:
        self.rollouts += 1
        rollout = self.emergency.roll(pilot, ticks)
        return rollout, self.judge.shortfall(rollout)

    def candidates(self, drivers: Sequence[ControllerParams]) -> Iterator[tuple[str, Rollout]]:
        """Yield the rollouts that may survive, and how they were driven."""
        approaches = sides.approaches(self.emergency)
        costs = np.full(len(approaches), np.inf)
        for driver in drivers:
            for i, approach in enumerate(approaches):
                if self.rollouts >= self._budget:
                    return
                rollout, lack = self._roll(Foresight(self.emergency, driver, approach))
                costs[i] = min(costs[i], lack.cost)
                if lack.may_survive:
                    yield f'an MPCC with hindsight, approach {i}', rollout
        starts = []
        for i, approach in enumerate(approaches):
            if self.rollouts >= self._budget:
                return
            shape = _Shape(self.emergency, approach)
            rollout, lack = self._roll(shape.pilot(shape.start))
            starts.append((min(lack.cost, costs[i]), i, shape))
            if lack.may_survive:
                yield f'a tracked approach {i}', rollout
        starts.sort(key=lambda start: start[:2])
        for _, _, shape in starts:
            seed = int(self._rng.integers(2**31))
            shape.search = CMA(shape.start / shape.scale, 1.0, seed=seed)
        del starts[STARTS:]
        while any(not shape.has_settled for _, _, shape in starts):
            for _, i, shape in starts:
                if not shape.has_settled:
                    for rollout in self._generation(shape):
                        yield f'a manoeuvre around approach {i}', rollout
                if self.rollouts >= self._budget:
                    return

    def _generation(self, shape):
        """Drive a generation and yield those that may survive."""
        costs = []
        candidates = [shape.search.ask() for _ in range(shape.search.population_size)]
        for vector in (candidate * shape.scale for candidate in candidates):
            _, lack = self._roll(shape.pilot(vector), shape.ticks)
            costs.append(lack.cost + EFFORT * shape.effort(vector))
            if lack.may_survive:
                whole, lack = self._roll(shape.pilot(vector))
                if lack.may_survive:
                    yield whole
        shape.search.tell([*zip(candidates, costs)])
        shape.best.append(min(costs))


class _Shape:
    """Manoeuvres around an approach as vectors: changes of offset, braking, tracking.

    They are searched by CMA-ES in units of their scale: Hansen, "The CMA Evolution Strategy: A
    Tutorial".
    """

    def __init__(self, emergency: Emergency, approach: Approach):
        self._emergency, self._approach = emergency, approach
        now = emergency.car.state
        s0 = float(emergency.course.project(now.X, now.Y)[0])
        speed = max(float(np.hypot(now.vx, now.vy)), 5.0)
        self.ticks = _judged_ticks(emergency, s0, speed)
        time_s = self.ticks * TICK_S
        self._s = np.arange(s0, s0 + speed * time_s + 1.0, max(4.0, speed * KNOT_S))
        self._t = np.arange(0.0, time_s + BRAKE_KNOT_S, BRAKE_KNOT_S)
        self._grip = emergency.setup.friction * emergency.setup.plant.car.body.gravity_mps2
        braking = np.full(len(self._t), approach.braking / self._grip)
        self.start = np.concatenate([np.zeros(len(self._s)), braking, np.zeros(3)])
        scales = (np.full(len(self._s), OFFSET_SCALE_M), np.full(len(self._t), BRAKE_SCALE))
        self.scale = np.concatenate([*scales, np.full(3, 0.25)])
        self.best: list[float] = []  # cost of each generation

    @property
    def has_settled(self) -> bool:
        """Whether the last generations were no better than those before."""
        if len(self.best) <= SETTLED_GENERATIONS:
            return False
        before, last = self.best[:-SETTLED_GENERATIONS], self.best[-SETTLED_GENERATIONS:]
        return min(last) > (1 - SETTLED_SHARE) * min(before)

    def pilot(self, vector: np.ndarray) -> Tracker:
        m, k = len(self._s), len(self._t)
        changes, braking, tracking = vector[:m], vector[m : m + k], vector[m + k :]
        a, course = self._approach, self._emergency.course
        # nothing is changed where the car is
        near = np.clip((a.path.s - self._s[0]) / 5.0, 0.0, 1.0)
        n = a.offsets + near * _smooth(a.path.s, self._s, changes)
        right, left = course.room(a.path.s)
        path = course.shifted(a.path.s, np.clip(n, np.minimum(right, left), left))
        t = np.arange(self.ticks) * TICK_S
        ax = -self._grip * np.interp(t, self._t, np.clip(braking, -0.3, 1.2))
        # afterwards to a stop: what was survived stays survived
        ax = np.append(ax, -0.35 * self._grip)
        lookahead, gain, slip = np.exp(np.clip(tracking, -1.0, 1.0))
        manoeuvre = Manoeuvre(path, ax, 0.5 * lookahead, 0.06 * gain, 0.14 * slip)
        return Tracker(self._emergency, manoeuvre)

    def effort(self, vector: np.ndarray) -> float:
        """Return how much a manoeuvre differs from its approach: the tie-breaker of the search."""
        return float(np.mean(((vector - self.start) / self.scale) ** 2))


def _smooth(s, knots, values):
    """Return a smooth line through knots at s, constant beyond them."""
    if len(knots) < 3:
        return np.interp(s, knots, values)
    return CubicSpline(knots, values, bc_type='natural')(np.clip(s, knots[0], knots[-1]))


def _judged_ticks(emergency, s0, speed):
    """Return the ticks until every obstacle lies behind a car that goes on from s0 at a speed."""
    last = 0
    for k in range(emergency.most_ticks):
        stamp = emergency.start_ns + round(k * TICK_S * NS_PER_S)
        for o in emergency.discs_at(stamp).values():
            s = float(emergency.course.project(o.X, o.Y)[0])
            if abs(s - s0 - speed * k * TICK_S) < o.r_obs + 8.0:
                last = k
    return min(emergency.most_ticks, max(last + round(AFTER_S / TICK_S), round(3.0 / TICK_S)))
