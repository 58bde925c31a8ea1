"""The search distribution finds minima that are known."""

import numpy as np
import pytest

from experiments.survivable.evolution import Evolution


def minimise(cost, start, scale, generations, seed=3):
    evolution = Evolution(np.array(start), np.array(scale), np.random.default_rng(seed))
    for _ in range(generations):
        candidates = evolution.ask()
        evolution.tell(candidates, np.array([cost(x) for x in candidates]))
    return evolution.mean


def test_the_curved_valley_of_rosenbrock_is_followed_to_its_end():
    def cost(x):
        return np.sum(100 * (x[1:] - x[:-1] ** 2) ** 2 + (1 - x[:-1]) ** 2)

    assert minimise(cost, np.zeros(5), np.full(5, 0.5), 400) == pytest.approx(1.0, abs=1e-4)


def test_units_make_no_difference():
    """A coordinate in other units, with its scale in them, is searched alike."""
    units = np.array([1.0, 1e3, 1e-3])

    def cost(x):
        return np.sum((x - [3.0, 1.0, -2.0]) ** 2)

    plain = minimise(cost, np.zeros(3), np.ones(3), 10)
    scaled = minimise(lambda x: cost(x / units), np.zeros(3), units, 10)
    assert scaled / units == pytest.approx(plain, rel=1e-9)
