"""The search for the weights of an arm: the same tasks, random numbers and budget for every arm.

Quasi-random points of the logarithms; then CMA-ES (Hansen, "The CMA Evolution Strategy: A
Tutorial") from the mean of the best of them; last the best of all points on more tasks. A point is
its share of each range, (n,) in 0 to 1.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from cmaes import CMA
from scipy.stats import qmc

DIGITS = 4  # significant, of weights
Weights = Mapping[str, float]  # by parameter of a controller
# costs (points, tasks) of weights in tasks, the first and the last but one
Drive = Callable[[Sequence[Weights], int, int], np.ndarray]


class Trial(NamedTuple):
    """A point of the search, on as many tasks as it was driven in."""

    stage: int
    weights: Weights
    cost: float  # mean over tasks
    drives: int  # of the search, up to the end of its generation


def search(
    ranges: Mapping[str, Sequence[float]], budget: Mapping[str, Any], seed: int, drive: Drive
) -> list[Trial]:
    """Return every trial in the order of the search; the last stage's least cost wins.

    ranges  least and greatest value of each weight
    budget  `first`, `evolution` and `last` of the plan
    drive   returns the costs (points, tasks) of weights in consecutive tasks
    """
    trials: list[Trial] = []
    first, evolution, last = (budget[name] for name in ('first', 'evolution', 'last'))
    count, dimensions = 0, len(ranges)

    def judge(stage, points, begin, tasks):
        nonlocal count
        weights = [_weights(ranges, point) for point in points]
        costs = drive(weights, begin, begin + tasks).mean(axis=1)
        count += len(points) * tasks
        trials.extend(Trial(stage, w, float(cost), count) for w, cost in zip(weights, costs))
        return costs

    sobol = qmc.Sobol(dimensions, seed=np.random.default_rng(seed))
    points = sobol.random_base2(int(np.ceil(np.log2(first['points']))))[: first['points']]
    costs = judge(1, points, 0, first['tasks'])
    best = points[np.argsort(costs, kind='stable')[: evolution['from_best']]]
    strategy = CMA(
        best.mean(axis=0),
        evolution['sigma'],
        bounds=np.tile([0.0, 1.0], (dimensions, 1)),
        population_size=evolution['size'],
        seed=seed,
    )
    begin = first['tasks']
    for _ in range(evolution['generations']):
        points = np.array([strategy.ask() for _ in range(evolution['size'])])
        costs = judge(2, points, begin, evolution['tasks'])
        strategy.tell(list(zip(points, costs)))
    begin += evolution['tasks']
    # the centre of the last generation is no point that was driven; it is often the best
    ranked = sorted(trials, key=lambda trial: trial.cost)[: last['points'] - 1]
    finalists = [trial.weights for trial in ranked] + [_weights(ranges, strategy.mean)]
    costs = drive(finalists, begin, begin + last['tasks']).mean(axis=1)
    count += len(finalists) * last['tasks']
    return trials + [Trial(3, w, float(cost), count) for w, cost in zip(finalists, costs)]


def winner(trials: Sequence[Trial]) -> Trial:
    """Return the trial of the last stage with the least cost."""
    return min((trial for trial in trials if trial.stage == 3), key=lambda trial: trial.cost)


def _weights(ranges, point):
    values = (low * (high / low) ** share for (low, high), share in zip(ranges.values(), point))
    return {name: float(f'{value:.{DIGITS}g}') for name, value in zip(ranges, values)}
