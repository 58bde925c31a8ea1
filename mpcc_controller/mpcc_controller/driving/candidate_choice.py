"""Which of the solved candidates is driven, with hysteresis, and which are kept. SI units."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mpcc_controller.driving.obstacle_passing import Sides, are_opposed
from mpcc_controller.driving.prediction_model import TickProblem
from mpcc_controller.model.single_track import Car, State
from mpcc_controller.parameters import Candidates, ControllerParams
from mpcc_controller.path import reference_path
from mpcc_controller.problem.stage_parameters import Scene
from stage_solver.solution import Solution

CONTACT_M = 0.0  # a plan whose circles come nearer than this touches
STILL_CLEAR_M = 0.02  # by which the circles of the followed plan may overlap: noise moves them
SPEED_STEP_MPS = 2.0  # contact speeds that differ by less count as equal
OFF_ROAD_M = 0.05  # a circle at the CoG may be so far off the road: the constraint is soft


class Outcome(NamedTuple):
    """A solved candidate."""

    name: str
    problem: TickProblem
    solution: Solution  # in the map
    rejection: str  # why it must not be driven, '' if it may
    sides: Sides  # on which the plan passes the dangerous obstacles
    least_gap: float  # m, V2O to every obstacle over the horizon
    off_road: float  # m, by which the slack lets the circles leave the road
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

    @property
    def is_clean(self) -> bool:
        """Whether the plan may be driven, touches nothing and stays on the road."""
        return self.is_almost_clean(0.0)

    def is_almost_clean(self, overlap: float) -> bool:
        """Return whether it is clean but for an overlap [m] of circles."""
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


class CandidateChooser:
    """Chooses the cheapest plan; another one than the followed must be cheaper by a share.

    Plans that touch an obstacle or leave the road lose against those that do not, and of plans
    that run into an obstacle the slower ones win. After a switch
    the share is larger for some ticks. A followed plan that cannot be driven, or is not clean, is
    left at once for one that is better.
    """

    def __init__(self, params: Candidates):
        self.params = params
        self.reset()

    def reset(self) -> None:
        """Forget that there was a switch."""
        self._hold = 0  # ticks left in which the larger share counts

    def choose(self, outcomes: Sequence[Outcome], path_sides: Sides) -> Choice:
        """Return the choice; the first outcome is that of the followed plan.

        `path_sides` are the sides on which the coarse path passes obstacles. Without a usable
        outcome the followed one is chosen.
        """
        self._hold, share = max(self._hold - 1, 0), self.params.switch_share
        if self._hold:
            share = self.params.hold_share
        costs = [self._cost(outcome, path_sides) for outcome in outcomes]
        clean = [o.is_almost_clean(0.0 if i else STILL_CLEAR_M) for i, o in enumerate(outcomes)]
        # plans that touch: the slower ones first, in steps of SPEED_STEP_MPS
        order = [
            (not o.is_usable, not is_clean, round(o.contact_speed / SPEED_STEP_MPS), cost)
            for o, is_clean, cost in zip(outcomes, clean, costs)
        ]
        best = min(range(len(outcomes)), key=order.__getitem__)
        if order[best][:3] == order[0][:3] and not costs[best] < (1 - share) * costs[0]:
            best = 0
        switched = are_opposed(outcomes[0].sides, outcomes[best].sides)
        if switched:
            self._hold = self.params.hold_ticks
        return Choice(tuple(outcomes), best, switched)

    def _cost(self, outcome, path_sides) -> float:
        """Return the cost, larger against the coarse path; inf if it is not a number."""
        cost = outcome.whole_cost
        if not np.isfinite(cost):
            return np.inf
        against = are_opposed(outcome.sides, path_sides)
        return cost * (1 + self.params.path_share) if against else cost


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
