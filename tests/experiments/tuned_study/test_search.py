"""The search finds the weights of least cost, with the same budget for every arm."""

import numpy as np
import pytest

from experiments.tuned_study import search

RANGES = {'near': (0.1, 10.0), 'far': (1.0, 1e4), 'third': (0.01, 1.0)}
BUDGET = {'first': {'points': 32, 'tasks': 4}, 'rounds': {'count': 6, 'points': 8, 'tasks': 4}}
BEST = {'near': 0.5, 'far': 2000.0, 'third': 0.05}


def bowl(asked, noise=0.0, names=tuple(BEST)):
    """Return what drives: costs grow with the square of the ratio to BEST, and with the task."""
    rng = np.random.default_rng(0)

    def drive(weights, begin, end):
        asked.append((weights, begin, end))
        away = [sum(np.log(w[name] / BEST[name]) ** 2 for name in names) for w in weights]
        costs = np.add.outer(away, np.arange(begin, end) / 10.0)
        return costs + noise * rng.normal(size=costs.shape)

    return drive


def run(seed, drive, names=tuple(RANGES)):
    """Return the trials of a search."""
    return search.search(RANGES, names, BUDGET, seed, drive)


def test_what_is_recommended_is_near_the_least_cost():
    trials = run(1, bowl([]))
    best = trials[-1]
    assert best.is_recommended
    for name, value in BEST.items():
        # over two to four powers of ten
        assert best.weights[name] == pytest.approx(value, rel=0.05)
        assert float(f'{best.weights[name]:.4g}') == best.weights[name]


def test_where_tasks_scatter_more_than_points_it_is_not_the_luckiest_point():
    """Noise of 3 per drive, 4 drives per point: the luckiest point is 3 too good by chance."""
    trials = run(4, bowl([], noise=3.0))
    points = [trial for trial in trials if not trial.is_recommended]
    true = bowl([])
    recommended, luckiest = (
        true([weights], 0, 1)[0, 0]
        for weights in (trials[-1].weights, min(points, key=lambda t: t.cost).weights)
    )
    assert recommended < 0.5
    assert recommended <= luckiest


def test_the_budget_is_spent_whole_and_every_round_has_fresh_tasks():
    asked = []
    trials = run(2, bowl(asked))
    assert [len(weights) for weights, *_ in asked] == [32] + [8] * 6
    assert [begin for _, begin, _ in asked] == [end for *_, end in [(0, 0), *asked[:-1]]]
    assert trials[-1].drives == 32 * 4 + 6 * 8 * 4
    assert sum(trial.is_recommended for trial in trials) == 7


def test_an_arm_without_a_weight_begins_with_the_same_points():
    every, two = [], []
    run(3, bowl(every))
    run(3, bowl(two, names=('near', 'third')), ('near', 'third'))
    assert [{k: w[k] for k in ('near', 'third')} for w in every[0][0]] == two[0][0]


def test_a_seed_repeats_a_search_and_another_one_differs():
    first, again, other = (run(seed, bowl([])) for seed in (3, 3, 4))
    assert first == again
    assert first != other
