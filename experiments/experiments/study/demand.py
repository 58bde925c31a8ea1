"""The lateral acceleration that a scenario demands of any car, by a linear program.

A point mass drives along a straight road at constant speed v. Its lateral position y(x) has the
curvature y'' = a / v^2 (small heading angles), with one acceleration a per STEP_M of road. The
constraints are the safety distances to obstacles and edges, on the sides on which the coarse path
passes the obstacles; the program minimises the largest |a|. The result is a property of the task:
no controller and no tyre model is involved.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from bags.errors import BagError
from experiments import simulation
from experiments.configuration.inputs import KPH
from experiments.plant_limit import lateral_limit
from experiments.study import tables
from experiments.study.variants import SCENARIO, Variant

STEM = 'demand'
COMMAND = 'experiments study demand'
CONTROLLER = 'mpcc'  # its circle, safety distances and horizon are used; all have the same
STEP_M = 0.5
SPEEDS_KPH = (75.0, 90.0, 110.0, 130.0, 160.0, 190.0)


class Circle(NamedTuple):
    """An area that the centre of gravity must not enter, and the side on which it passes."""

    x: float  # m, centre
    y: float  # m
    radius: float  # m, obstacle + vehicle circle + safety distance
    on_left: bool  # whether the car passes to the left of the obstacle, y above it


class Task(NamedTuple):
    """The bounds of the centre of gravity on a straight road; arrays (n,) over x."""

    x: np.ndarray  # m, ascending, driving direction
    low: np.ndarray  # m, least y allowed by the right edge
    high: np.ndarray  # m, largest y allowed by the left edge
    circles: tuple[Circle, ...]

    def __repr__(self) -> str:
        return f'Task({self.x[0]:g} to {self.x[-1]:g} m, circles={self.circles})'


def least_peak(task: Task, speed: float, start: float | None = None) -> float:
    """Return the least peak lateral acceleration [m/s^2] that keeps a point mass within a task.

    The car enters at y = 0 without heading angle and may steer from x = `start` [m] on (default:
    the first x). Returns inf when no acceleration, however large, keeps it within the task.
    """
    begin = 0 if start is None else int(np.searchsorted(task.x, start - STEP_M / 2))
    station = task.x[begin:]
    x = station - station[0]
    low, high = (bound[begin:].copy() for bound in (task.low, task.high))
    for area in task.circles:
        beside = np.abs(station - area.x) < area.radius
        half = np.sqrt(area.radius**2 - (station[beside] - area.x) ** 2)
        if area.on_left:
            low[beside] = np.maximum(low[beside], area.y + half)
        else:
            high[beside] = np.minimum(high[beside], area.y - half)
    if low[0] > 0.0 or high[0] < 0.0 or np.any(low > high):
        return float('inf')
    # unknowns: y and y' at every x, a in every interval, the peak; sparse, so that thousands of
    # tasks can be solved
    count = len(x) - 1
    step, curvature = np.diff(x), 1.0 / speed**2
    here, there = sparse.eye(count, count + 1), sparse.eye(count, count + 1, 1)
    moved, turned = (sparse.diags(curvature * step**power / power) for power in (2, 1))
    motion = sparse.bmat(
        [
            [there - here, -sparse.diags(step) @ here, -moved, None],
            [None, there - here, -turned, sparse.csr_matrix((count, 1))],
        ]
    )
    states = sparse.csr_matrix((count, 2 * len(x)))
    peak_column = sparse.csr_matrix(np.ones((count, 1)))
    identity = sparse.identity(count)
    within = sparse.bmat([[states, identity, -peak_column], [states, -identity, -peak_column]])
    bounds = [(0.0, 0.0), *zip(low[1:], high[1:]), (0.0, 0.0), *[(None, None)] * (2 * count)]
    solution = linprog(
        c=np.append(np.zeros(2 * len(x) + count), 1.0),
        A_ub=within,
        b_ub=np.zeros(2 * count),
        A_eq=motion,
        b_eq=np.zeros(2 * count),
        bounds=[*bounds, (0.0, None)],
    )
    return float(solution.fun) if solution.success else float('inf')


def build_task() -> tuple[Task, float]:
    """Return the task of SCENARIO and the duration of the controller's horizon [s].

    Raises BagError for a road that is not straight along x, for a moving obstacle, and for a car
    that does not start on the x axis.
    """
    setup = simulation.prepare(SCENARIO, CONTROLLER)
    scn, params = setup.scn, setup.params
    path = np.column_stack([scn.reference.X, scn.reference.Y])
    edges = {'left': scn.edges.left, 'right': scn.edges.right}
    if any(np.any(np.diff(edge[:, 0]) <= 0.0) for edge in (path, *edges.values())):
        raise BagError(f'{SCENARIO}: the linear program needs a straight road along x')
    if scn.start.Y or scn.start.psi:
        raise BagError(f'{SCENARIO}: the linear program needs a start on the x axis')
    x = np.arange(scn.start.X, scn.stop.X + STEP_M / 2, STEP_M)
    room = params.body.circle_radius_m + params.safety.edge_m
    circles = []
    for obstacle in scn.obstacles.items:
        if obstacle.vX or obstacle.vY:
            raise BagError(f'{SCENARIO}: the linear program needs obstacles that stand still')
        radius = obstacle.r_obs + params.body.circle_radius_m + params.safety.obstacle_m
        on_left = bool(np.interp(obstacle.X, *path.T) > obstacle.Y)
        circles.append(Circle(obstacle.X, obstacle.Y, radius, on_left))
    task = Task(
        x,
        np.interp(x, *edges['right'].T) + room,
        np.interp(x, *edges['left'].T) - room,
        tuple(circles),
    )
    return task, params.model.horizon * params.model.step_s


def run(out: Path) -> list[Path]:
    """Write demand.md, .csv and .json into the folder `out`; return their paths.

    One row per speed of SPEEDS_KPH: the least peak acceleration when the whole road is known from
    the start, and when an obstacle is known from the controller's horizon on; both also as shares
    of what the plant holds in a steady turn. Raises BagError.
    """
    task, horizon_s = build_task()
    limit = lateral_limit(simulation.prepare(SCENARIO, CONTROLLER).plant)
    rows = [_row(task, horizon_s, limit, kph) for kph in SPEEDS_KPH]
    limits_of = [Variant('limits', CONTROLLER)]
    origin = tables.build_provenance(COMMAND, limits_of, plant_limit_mps2=limit)
    text = _markdown(rows, limit)
    return tables.write_tables(out, STEM, 'What the task demands', rows, text, origin)


def _row(task, horizon_s, limit, kph) -> dict[str, Any]:
    speed = kph / KPH
    first = min(area.x for area in task.circles)
    known = max(float(task.x[0]), first - speed * horizon_s)
    full, preview = least_peak(task, speed), least_peak(task, speed, known)
    return {
        'speed_kph': kph,
        'needed_mps2': full,
        'share': full / limit,
        'needed_within_horizon_mps2': preview,
        'share_within_horizon': preview / limit,
    }


def _markdown(rows, limit):
    header = [
        'speed [km/h]',
        *('needed, road known from the start [m/s²]', 'share of the plant'),
        *('needed, obstacle known from the horizon on [m/s²]', 'share of the plant'),
    ]
    forms = ('g', '.2f', '.0%', '.2f', '.0%')
    lines = [[f'{value:{form}}' for value, form in zip(row.values(), forms)] for row in rows]
    return (
        'Least peak lateral acceleration with which a point mass at constant speed keeps the '
        f'safety distances. The plant holds {limit:.2f} m/s² in a steady turn.\n\n'
        f'{tables.markdown_table(header, lines)}'
    )
