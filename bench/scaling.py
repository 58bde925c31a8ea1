"""How does the cost of a tick grow with the horizon, the obstacles and the vehicle circles?"""

from dataclasses import replace
from typing import NamedTuple

import interleaved_runs
import numpy as np
import problems
import solver_variants
import summary
from closed_loops import Loop
from interleaved_runs import WARM
from rich.progress import Progress
from solver_variants import Variant
from tables import TextTable, number

from mpcc_controller.parameters import ControllerParams
from mpcc_controller.problem import mpcc_formulation, ocp

PASSES = 3
# 30 ticks with obstacles around; every horizon ends on the road
ROAD = Loop('long road', 'long_road.yaml', 'mpcc', None, range(15, 46))
HORIZONS = (25, 50, 100, 200)
OBSTACLES = (1, 4, 10)
# m ahead of the CoG and radius [m], by the number of circles
CIRCLES = {1: ((0.0,), 1.1), 3: ((-1.4, 0.0, 1.4), 1.0)}


class Size(NamedTuple):
    """The size of a problem."""

    horizon: int
    obstacles: int
    circles: int


def sizes(params: ControllerParams) -> list[Size]:
    """Return the sizes to measure: every horizon, then every number of obstacles and circles."""
    here = params.model.horizon, params.surroundings.max_obstacles, 1
    along = [Size(N, *here[1:]) for N in HORIZONS]
    across = [Size(here[0], o, c) for c in CIRCLES for o in OBSTACLES]
    return along + [size for size in across if size not in along]


def sized(params: ControllerParams, size: Size) -> ControllerParams:
    """Return the parameters of a controller whose problem has that size."""
    offsets, radius = CIRCLES[size.circles]
    body = replace(params.body, circle_offsets_m=offsets, circle_radius_m=radius)
    around = replace(params.surroundings, max_obstacles=size.obstacles)
    model = replace(params.model, horizon=size.horizon)
    return replace(params, model=model, body=body, surroundings=around)


def measure(params: ControllerParams, progress: Progress) -> tuple[TextTable, list[dict]]:
    """Return a table and its figures: time per tick and iteration by size and solver."""
    chosen = [
        variant
        for variant in solver_variants.available(params, interpreted=False)
        if variant.label in (solver_variants.OURS, solver_variants.BASELINE)
    ]
    figures = []
    for size in progress.track(sizes(params), description='scaling'):
        figures += measured(sized(params, size), size, chosen)
    order = [variant.options.name for variant in chosen]
    columns = ('solver', *Size._fields, 'median ms', 'iterations', 'us per iteration and stage')
    rows = [
        (
            one['solver'],
            *(str(one[field]) for field in Size._fields),
            number(one['median_ms']),
            f'{one["median_iterations"]:.0f}',
            number(one['us_per_iteration_and_stage']),
        )
        for one in sorted(figures, key=lambda one: order.index(one['solver']))
    ]
    return TextTable('Cost of a tick by the size of the problem', columns, rows), figures


def measured(params: ControllerParams, size: Size, chosen: list[Variant]) -> list[dict]:
    """Return the figures of every solver for one size."""
    given = problems.record([ROAD], lambda _: params)
    model = params.model
    problem = ocp.build(
        mpcc_formulation.symbolic_ocp(size.circles, size.obstacles), model.horizon, model.step_s
    )
    solvers = solver_variants.make_solvers(problem, chosen, params)
    tasks = {
        label: [
            task
            for task in interleaved_runs.tasks(problem, given, params.fallback, one, len(given.x0))
            if task.kind == WARM
        ]
        for label, one in solvers.items()
    }
    ran = interleaved_runs.run(solvers, tasks, PASSES, lambda: None)
    return [figures_of(v.options.name, ran, v.label, size) for v in chosen]


def figures_of(name: str, ran: interleaved_runs.Timings, label: str, size: Size) -> dict:
    """Return the figures of one solver."""
    iterations = np.array([answer.iterations for answer in ran.answers[label]])
    us = np.median(ran.seconds[label], axis=0) * 1e6 / np.maximum(iterations, 1) / size.horizon
    return {
        'solver': name,
        **size._asdict(),
        **summary.times(ran.seconds[label]),
        'median_iterations': float(np.median(iterations)),
        'us_per_iteration_and_stage': float(np.median(us)),
    }
