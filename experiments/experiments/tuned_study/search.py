"""The search for the weights of an arm: the same tasks, random numbers and budget for every arm.

Bayesian optimisation under noise: quasi-random points of the logarithms; then rounds of points that
a Gaussian process of all costs so far proposes by Thompson sampling (Russo et al. 2018, doi
10.1561/2200000070), in fresh tasks. The cost of a task scatters more than what the best points
differ by, so what is recommended is not the best point that was driven, but where the mean of the
process is least. A point is its share of each range, (n,) in 0 to 1.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import qmc
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern

DIGITS = 4  # significant, of weights
# of which the process is asked: a half anywhere, a half near points with a low mean
CANDIDATES = 3000
SAMPLED = 300  # of them, with the least mean - 2 standard deviations
NEAR = 0.07  # standard deviation of these
PASSES = 3  # between length scales and the effects of tasks
Weights = Mapping[str, float]  # by parameter of a controller
# costs (points, tasks) of weights in tasks, the first and the last but one
Drive = Callable[[Sequence[Weights], int, int], np.ndarray]


class Trial(NamedTuple):
    """A point of the search, or what is recommended after a round of it."""

    round: int
    weights: Weights
    cost: float  # mean over tasks; of a recommendation that of the process
    drives: int  # of the search, up to the end of its round
    is_recommended: bool = False


class _Batch(NamedTuple):
    points: np.ndarray  # (points, dimensions)
    costs: np.ndarray  # (points, tasks)


def search(
    ranges: Mapping[str, Sequence[float]],
    names: Sequence[str],
    budget: Mapping[str, Any],
    seed: int,
    drive: Drive,
) -> list[Trial]:
    """Return every trial in the order of the search; the last is the recommended one.

    ranges  least and greatest value of the weights of all arms
    names   those of this arm
    budget  `first` and `rounds` of the plan
    drive   returns the costs (points, tasks) of weights in consecutive tasks
    """
    own = [list(ranges).index(name) for name in names]
    limits = {name: ranges[name] for name in names}
    rng = np.random.default_rng(seed)
    sobol = qmc.Sobol(len(ranges), seed=rng)
    points = sobol.random_base2(int(np.ceil(np.log2(budget['first']['points']))))
    points = points[: budget['first']['points'], own]
    sizes = [budget['first']['tasks'], *[budget['rounds']['tasks']] * budget['rounds']['count']]
    trials: list[Trial] = []
    batches: list[_Batch] = []
    begin = count = 0
    for number, tasks in enumerate(sizes):
        weights = [_weights(limits, point) for point in points]
        batches.append(_Batch(points, drive(weights, begin, begin + tasks)))
        begin += tasks
        count += len(points) * tasks
        means = batches[-1].costs.mean(axis=1)
        trials.extend(Trial(number, w, float(m), count) for w, m in zip(weights, means))
        anywhere = rng.random((CANDIDATES // 2, len(ranges)))[:, own]
        near = rng.normal(0.0, NEAR, (CANDIDATES // 2, len(ranges)))[:, own]
        best, cost, points = _propose(batches, anywhere, near, budget['rounds']['points'], seed)
        trials.append(Trial(number, _weights(limits, best), cost, count, True))
    return trials


def _propose(batches, anywhere, near, count, seed):
    """Return the point with the least mean (n,), that mean, and it with others (count, n)."""
    driven = np.concatenate([batch.points for batch in batches])
    process, level = _fit(batches)
    low = driven[np.argsort(process.predict(driven))[: 1 + len(driven) // 4]]
    near = np.clip(low[np.arange(len(near)) % len(low)] + near, 0.0, 1.0)
    candidates = np.concatenate([driven, anywhere, near])
    mean, deviation = process.predict(candidates, return_std=True)
    best = candidates[np.argmin(mean)]
    promising = candidates[np.argsort(mean - 2.0 * deviation)[:SAMPLED]]
    samples = process.sample_y(promising, count - 1, random_state=seed)
    points = np.concatenate([best[None], promising[np.argmin(samples, axis=0)]])
    return best, float(mean.min() + level), points


def _fit(batches):
    """Return a Gaussian process of the cost of a point, less a level, and this level.

    The tasks of a batch are harder or easier for all of its points. These effects are estimated by
    generalised least squares under the process (universal kriging; Rasmussen and Williams 2006,
    section 2.7), in turn with its length scales.
    """
    points = np.concatenate([batch.points for batch in batches])
    batch_index = np.repeat(np.arange(len(batches)), [len(batch.points) for batch in batches])
    costs = np.concatenate([batch.costs.mean(axis=1) for batch in batches])
    squares = sum(np.sum(_residuals(batch.costs) ** 2) for batch in batches)
    freedom = sum((len(c) - 1) * max(1, c.shape[1] - 1) for _, c in batches)
    tasks = np.array([batch.costs.shape[1] for batch in batches])
    noise = max(1e-4, squares / freedom) / tasks[batch_index]
    kernel = ConstantKernel(10.0) * Matern(np.full(points.shape[1], 0.7), (0.15, 20.0), nu=2.5)
    indicators = np.eye(len(batches))[batch_index]
    for _ in range(PASSES):
        weighted = np.linalg.solve(kernel(points) + np.diag(noise), indicators)
        effects = np.linalg.solve(indicators.T @ weighted, weighted.T @ costs)
        process = GaussianProcessRegressor(kernel, alpha=noise)
        with warnings.catch_warnings():
            # a weight without influence has the longest length scale
            warnings.simplefilter('ignore', ConvergenceWarning)
            process.fit(points, costs - indicators @ effects)
        kernel = process.kernel_
    return process, float(effects.mean())


def _residuals(costs):
    """Return what is left of costs (points, tasks) without the means of points and of tasks."""
    by_task = costs.mean(axis=0) if costs.shape[1] > 1 else 0.0
    return costs - costs.mean(axis=1, keepdims=True) - by_task + costs.mean()


def _weights(ranges, point):
    values = (low * (high / low) ** share for (low, high), share in zip(ranges.values(), point))
    return {name: float(f'{value:.{DIGITS}g}') for name, value in zip(ranges, values)}
