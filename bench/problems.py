"""The problems of closed loops: recorded once, kept in a file, the same for every solver."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

import closed_loops
import numpy as np
from closed_loops import Loop

from mpcc_controller.driving import initial_guess
from mpcc_controller.driving.controller import Controller
from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import reference_path
from msgs_yaml.types import Obstacle
from stage_solver.stage_problem import Bounds, Plan, ProblemError, StageProblem

POP_UP_EVERY = 6  # ticks
POP_UP_AHEAD_M = (15.0, 40.0)
POP_UP_BESIDE_M = (-1.5, 1.5)
POP_UP_RADIUS_M = (0.4, 1.2)
POP_UP_SEED = 1


class Problems(NamedTuple):
    """n problems in the order of the loops and their ticks; SI units.

    The numbers P of a stage depend on the guess around which they are made. `P` belongs to the plan
    moved on, `cold_P` to the drive along the path that starts a controller, `pop_up_P` to the plan
    moved on with one obstacle more than a tick before, in m of the n problems.
    """

    names: np.ndarray  # of the loops
    parameters: np.ndarray  # names of the columns of P
    loop: np.ndarray  # (n,) index into `names`
    tick: np.ndarray  # (n,)
    x0: np.ndarray  # (n, nx)
    P: np.ndarray  # (n, N + 1, np)
    cold_P: np.ndarray
    cold_X: np.ndarray  # (n, N + 1, nx)
    cold_U: np.ndarray  # (n, N, nu)
    driven_X: np.ndarray  # the plan that was driven
    driven_U: np.ndarray
    pop_up: np.ndarray  # (m,) which of the n problems
    pop_up_P: np.ndarray  # (m, N + 1, np)
    bounds: Bounds  # every field (n, ...)

    def continues(self, k: int) -> bool:
        """Tell whether problem k is one tick later than the problem before it."""
        return k > 0 and self.loop[k] == self.loop[k - 1] and self.tick[k] == self.tick[k - 1] + 1

    def bounds_of(self, k: int) -> Bounds:
        """Return the bounds of problem k."""
        return Bounds(*(field[k] for field in self.bounds))

    def cold_start(self, k: int) -> Plan:
        """Return the guess of problem k that needs no earlier plan."""
        return Plan(self.cold_X[k], self.cold_U[k])


class Recorder:
    """A StageSolver that keeps the arguments of its last call."""

    def __init__(self, inner):
        self.inner = inner
        self.last = None

    def solve(self, x0, P, bounds, start):
        """Solve, and keep the arguments."""
        self.last = x0, P, bounds, start
        return self.inner.solve(x0, P, bounds, start)


def record(
    chosen: Iterable[Loop],
    params_of: Callable[[str], ControllerParams] = closed_loops.controller_params,
) -> Problems:
    """Drive the loops and return their problems; equal loops give equal problems.

    `params_of` returns the parameters of a loop's controller by its name.
    """
    rows, pop_ups, names, parameters = [], [], [], ()
    random = np.random.default_rng(POP_UP_SEED)
    for index, loop in enumerate(chosen):
        names.append(loop.name)
        params = closed_loops.with_solver(params_of(loop.controller), closed_loops.RECORDING_SOLVER)
        scn = closed_loops.load_scenario(loop.scenario, loop.speed)
        controller = closed_loops.make_controller(params, scn.friction)
        for number, row, pop_up_P in recorded(controller, scn, loop.ticks, random):
            if pop_up_P is not None:
                pop_ups.append((len(rows), pop_up_P))
            rows.append({'loop': index, 'tick': number} | row)
        parameters = controller.planner.prediction.problem.parameters
    if not pop_ups:
        raise ValueError('these loops have no tick for a pop-up obstacle')
    columns = {name: np.stack([row[name] for row in rows]) for name in rows[0]}
    bounds = Bounds(*(columns.pop(name) for name in Bounds._fields))
    which, P = zip(*pop_ups)
    return Problems(
        names=np.array(names),
        parameters=np.array(parameters),
        **columns,
        pop_up=np.array(which),
        pop_up_P=np.stack(P),
        bounds=bounds,
    )


def recorded(controller: Controller, scn, ticks: range, random):
    """Drive and yield (tick, the problem's arrays by name, P with a pop-up obstacle or None)."""
    planner = controller.planner
    recorder = planner.solvers.first = Recorder(planner.solvers.first)
    for number, _ in enumerate(closed_loops.drive(scn, controller)):
        if number >= ticks.stop:
            break
        (x0, P, bounds, start), recorder.last = recorder.last or (None,) * 4, None
        plan = planner.fallback.plan
        if x0 is None or plan is None or number not in ticks:
            continue
        state, path = State(*x0), controller.scene.path
        model = controller.params.model
        cold = initial_guess.guess_from_path(
            path, state, controller.car, model.horizon, model.step_s
        )
        row = {
            'x0': x0,
            'P': P,
            'cold_P': planner.prediction.formulation.stage_parameters(controller.scene, cold.X).P,
            'cold_X': cold.X,
            'cold_U': cold.U,
            'driven_X': plan.X,
            'driven_U': plan.U,
        } | bounds._asdict()
        has_pop_up = number % POP_UP_EVERY == 0 and controller.params.priorities.obstacle > 0
        yield number, row, popped_up(controller, state, start, random) if has_pop_up else None


def popped_up(controller: Controller, x0: State, start: Plan, random) -> np.ndarray:
    """Return the stages' numbers with one more obstacle beside the path ahead."""
    scene = controller.scene
    at, _ = reference_path.arcs_at(scene.path, [x0.theta + random.uniform(*POP_UP_AHEAD_M)])
    X, Y, psi = (float(field[0]) for field in (at.X, at.Y, at.psi))
    beside = random.uniform(*POP_UP_BESIDE_M)
    known = scene.obstacles
    obstacle = Obstacle(
        id=1 + max((o.id for o in known.items), default=0),
        X=X - beside * np.sin(psi),
        Y=Y + beside * np.cos(psi),
        r_obs=random.uniform(*POP_UP_RADIUS_M),
        vX=0.0,
        vY=0.0,
    )
    scene = scene._replace(obstacles=known._replace(items=(*known.items, obstacle)))
    return controller.planner.prediction.formulation.stage_parameters(scene, start.X).P


def save(problems: Problems, path: Path) -> None:
    """Write the problems to a compressed file."""
    columns = problems._asdict()
    bounds = columns.pop('bounds')
    np.savez_compressed(path, **columns, **bounds._asdict())


def load(path: Path, problem: StageProblem) -> Problems:
    """Read the problems of a file. Raises ProblemError when they are those of another problem."""
    with np.load(path, allow_pickle=False) as file:
        columns = {name: file[name] for name in file.files}
    bounds = Bounds(*(columns.pop(name) for name in Bounds._fields))
    problems = Problems(**columns, bounds=bounds)
    same = tuple(problems.parameters) == problem.parameters
    if not same or problems.P.shape[1] != problem.horizon + 1:
        raise ProblemError(f'{path} was recorded with another control problem; remove it')
    return problems
