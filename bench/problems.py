"""The problems of closed loops and how each solver starts on them."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import closed_loops
import numpy as np
from closed_loops import Loop

from experiments import simulation
from mpcc_controller.driving import guesses, tick_solvers
from mpcc_controller.driving.controller import Controller
from mpcc_controller.driving.fallback import Plans
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import Fallback
from mpcc_controller.path import reference_path
from mpcc_controller.problem.obstacle_motion import PredictedObstacle
from mpcc_controller.problem.stage_parameters import Scene
from stage_solver.reference_solvers import ReferenceSolver
from stage_solver.solver import StageSolver
from stage_solver.stage_problem import Bounds, Plan, StageProblem, shift

RECORDING_SOLVER = 'fatrop'  # its plans are driven
POP_UP_EVERY = 6  # ticks
POP_UP_AHEAD_M = (15.0, 40.0)
POP_UP_BESIDE_M = (-1.5, 1.5)
POP_UP_RADIUS_M = (0.4, 1.2)
POP_UP_SEED = 1
FIRST, WARM, COLD, POP_UP = 'first', 'warm', 'cold', 'pop-up'


class Posed(NamedTuple):
    """The problem of a tick, SI units.

    The numbers P of the stages depend on the guess around which they are made: `P` belongs to the
    plan moved on, `cold_P` to the drive along the path that starts a controller, `pop_up_P`, at
    some ticks, to the plan moved on with one obstacle more than a tick before.
    """

    loop: str
    tick: int
    x0: np.ndarray  # (nx,)
    P: np.ndarray  # (N + 1, np)
    bounds: Bounds
    cold_P: np.ndarray
    cold: Plan
    pop_up_P: np.ndarray | None


class Task(NamedTuple):
    """One solve: what kind of start it has, then the arguments of StageSolver.solve.

    FIRST is the first of a loop, which has no plan to start from; WARM has one; COLD could have one
    but must do without; POP_UP has one, but an obstacle has appeared.
    """

    kind: str
    x0: np.ndarray
    P: np.ndarray
    bounds: Bounds
    start: Plan


def record(loops: Iterable[Loop]) -> list[Posed]:
    """Drive the loops and return their problems; equal loops give equal problems."""
    random = np.random.default_rng(POP_UP_SEED)
    return [posed for loop in loops for posed in _recorded(loop, random)]


def _recorded(loop, random) -> Iterator[Posed]:
    setup = closed_loops.make_setup(loop)
    controller = Controller(setup.params, setup.vehicle)
    parts, model = controller.parts, setup.params.model
    options = tick_solvers.solver_options(setup.params, limit_time=False)
    parts.solvers.followed = ReferenceSolver(parts.model.problem, RECORDING_SOLVER, options)
    stage_parameters = parts.model.formulation.stage_parameters
    for number, step in enumerate(simulation.steps(setup, controller)):
        if number >= loop.ticks.stop:
            return
        attempt = step.record.attempt
        if not attempt or controller.memory.plans.plan is None or number not in loop.ticks:
            continue
        problem = attempt.problem
        scene, x0, guess = problem.scene, problem.x0, problem.guess_local
        cold = guesses.from_path(scene.path, x0, controller.car, model.horizon, model.step_s)
        pop_up_P = None
        if number % POP_UP_EVERY == 0 and setup.params.priorities.obstacle > 0:
            pop_up_P = stage_parameters(_popped_up(scene, x0, random), guess.X).P
        P, cold_P = problem.parameters.P, stage_parameters(scene, cold.X).P
        yield Posed(loop.name, number, guess.X[0], P, problem.bounds, cold_P, cold, pop_up_P)


def _popped_up(scene: Scene, x0: State, random) -> Scene:
    """Return the scene with one more obstacle beside the path ahead."""
    at, _ = reference_path.arcs_at(scene.path, [x0.theta + random.uniform(*POP_UP_AHEAD_M)])
    X, Y, psi = (float(field[0]) for field in (at.X, at.Y, at.psi))
    beside = random.uniform(*POP_UP_BESIDE_M)
    known = scene.obstacles
    obstacle = PredictedObstacle(
        id=1 + max((o.id for o in known.items), default=0),
        X=X - beside * np.sin(psi),
        Y=Y + beside * np.cos(psi),
        r_obs=random.uniform(*POP_UP_RADIUS_M),
        vX=0.0,
        vY=0.0,
    )
    return scene._replace(obstacles=known._replace(items=(*known.items, obstacle)))


def tasks(
    problem: StageProblem, given: list[Posed], rules: Fallback, solver: StageSolver, cold_every: int
) -> list[Task]:
    """Return the tasks of one solver: its own plans, moved on as in the controller, start them.

    Every `cold_every`-th problem is to be solved from a cold start as well.
    """
    warm, plans, before = [], Plans(), None
    for posed in given:
        follows = before and (before.loop, before.tick + 1) == (posed.loop, posed.tick)
        if not follows:
            plans = Plans()
        P, start, moved_on = posed.cold_P, posed.cold, None
        if plans.plan is not None:
            state = State(*posed.x0)
            moved_on = guesses.start_at(shift(plans.plan, problem.dynamics, before.P[-1]), state)
        if plans.is_warm(rules):
            P, start = posed.P, moved_on
            if plans.failures:  # as the controller does after a failure
                start = moved_on._replace(multipliers=None)
        task = Task(WARM if follows else FIRST, posed.x0, P, posed.bounds, start)
        plans, _ = plans.decide(rules, solver.solve(*task[1:]), moved_on)
        warm.append(task)
        before = posed
    cold = [Task(COLD, p.x0, p.cold_P, p.bounds, p.cold) for p in given[::cold_every]]
    pop_up = [
        task._replace(kind=POP_UP, P=posed.pop_up_P)
        for task, posed in zip(warm, given)
        if posed.pop_up_P is not None and task.kind == WARM
    ]
    return warm + cold + pop_up
