"""The search finds the weights of least cost, with the same budget for every arm."""

import numpy as np
import pytest

from experiments.decisive import search

RANGES = {'near': (0.1, 10.0), 'far': (1.0, 1e4), 'third': (0.01, 1.0)}
BUDGET = {
    'first': {'points': 16, 'tasks': 2},
    'evolution': {'from_best': 3, 'sigma': 0.15, 'generations': 12, 'size': 8, 'tasks': 3},
    'last': {'points': 4, 'tasks': 5},
}
BEST = {'near': 0.5, 'far': 2000.0, 'third': 0.05}


def bowl(asked):
    """Return what drives: costs grow with the square of the ratio to BEST, and with the task."""

    def drive(weights, begin, end):
        asked.append((len(weights), begin, end))
        away = [sum(np.log(w[name] / BEST[name]) ** 2 for name in BEST) for w in weights]
        return np.add.outer(away, np.arange(begin, end) / 100.0)

    return drive


def test_the_winner_is_near_the_least_cost():
    winner = search.winner(search.search(RANGES, BUDGET, 1, bowl([])))
    for name, value in BEST.items():
        assert winner.weights[name] == pytest.approx(value, rel=0.1)
        assert float(f'{winner.weights[name]:.4g}') == winner.weights[name]


def test_the_budget_is_spent_whole_and_the_last_stage_has_tasks_of_its_own():
    asked = []
    trials = search.search(RANGES, BUDGET, 2, bowl(asked))
    assert sum(count * (end - begin) for count, begin, end in asked) == trials[-1].drives
    assert trials[-1].drives == 16 * 2 + 12 * 8 * 3 + 4 * 5
    earlier = {task for _, begin, end in asked[:-1] for task in range(begin, end)}
    assert earlier.isdisjoint(range(*asked[-1][1:]))


def test_a_seed_repeats_a_search_and_another_one_differs():
    first, again, other = (search.search(RANGES, BUDGET, seed, bowl([])) for seed in (3, 3, 4))
    assert first == again
    assert first != other
