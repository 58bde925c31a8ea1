"""Minimisation without derivatives: CMA-ES (Hansen, "The CMA Evolution Strategy: A Tutorial")."""

import numpy as np
from cmaes import CMA


class Evolution:
    """A search distribution: `ask` for candidates, `tell` their costs, again and again."""

    def __init__(self, mean: np.ndarray, scale: np.ndarray, rng: np.random.Generator):
        """Start at a mean (n,) with the standard deviations `scale` (n,), all positive."""
        self._scale = np.asarray(scale, dtype=float)
        self._search = CMA(mean / self._scale, 1.0, seed=int(rng.integers(2**31)))
        self.size = self._search.population_size  # candidates of a generation

    @property
    def mean(self) -> np.ndarray:
        """The centre of the search distribution (n,)."""
        return self._search.mean * self._scale

    def ask(self) -> np.ndarray:
        """Return the candidates of a generation, (size, n)."""
        return np.array([self._search.ask() for _ in range(self.size)]) * self._scale

    def tell(self, candidates: np.ndarray, costs: np.ndarray) -> None:
        """Move the distribution towards the better ones of the candidates of the last `ask`."""
        self._search.tell([(x / self._scale, cost) for x, cost in zip(candidates, costs)])
