"""Minimisation without derivatives: CMA-ES (Hansen, "The CMA Evolution Strategy: A Tutorial").

Weighted recombination, cumulative step-size adaptation, rank-one and rank-mu update with the
default settings of the tutorial (its table 1), positive weights only.
"""

import numpy as np


class Evolution:
    """A search distribution: `ask` for candidates, `tell` their costs, again and again."""

    def __init__(self, mean: np.ndarray, scale: np.ndarray, rng: np.random.Generator):
        """Start at a mean (n,) with the standard deviations `scale` (n,), all positive."""
        self._rng = rng
        self._scale = np.asarray(scale, dtype=float)
        n = len(mean)
        self._n = n
        self.size = 4 + int(3 * np.log(n))  # candidates of a generation
        parents = self.size // 2
        weights = np.log((self.size + 1) / 2) - np.log(np.arange(1, parents + 1))
        self._w = weights / weights.sum()
        mu = 1.0 / np.sum(self._w**2)
        self._mu = mu
        self._c_sigma = (mu + 2) / (n + mu + 5)
        self._d_sigma = 1 + 2 * max(0.0, np.sqrt((mu - 1) / (n + 1)) - 1) + self._c_sigma
        self._c_c = (4 + mu / n) / (n + 4 + 2 * mu / n)
        self._c_1 = 2 / ((n + 1.3) ** 2 + mu)
        self._c_mu = min(1 - self._c_1, 2 * (mu - 2 + 1 / mu) / ((n + 2) ** 2 + mu))
        # expected length of a standard normal vector
        self._chi = np.sqrt(n) * (1 - 1 / (4 * n) + 1 / (21 * n**2))
        self._mean = np.asarray(mean, dtype=float) / self._scale
        self.sigma = 1.0
        self._path_sigma, self._path_c = np.zeros(n), np.zeros(n)
        self._C = np.eye(n)
        self._B, self._d = np.eye(n), np.ones(n)
        self._generation = 0

    @property
    def mean(self) -> np.ndarray:
        """The centre of the search distribution (n,)."""
        return self._mean * self._scale

    def ask(self) -> np.ndarray:
        """Return the candidates of a generation, (size, n)."""
        z = self._rng.standard_normal((self.size, self._n))
        return (self._mean + self.sigma * (z * self._d) @ self._B.T) * self._scale

    def tell(self, candidates: np.ndarray, costs: np.ndarray) -> None:
        """Move the distribution towards the better ones of the candidates of the last `ask`."""
        best = np.asarray(candidates)[np.argsort(costs, kind='stable')[: len(self._w)]]
        steps = (best / self._scale - self._mean) / self.sigma
        step = self._w @ steps
        self._mean = self._mean + self.sigma * step
        self._generation += 1
        white = self._B @ ((self._B.T @ step) / self._d)
        c = self._c_sigma
        self._path_sigma = (1 - c) * self._path_sigma + np.sqrt(c * (2 - c) * self._mu) * white
        length = np.linalg.norm(self._path_sigma)
        settled = np.sqrt(1 - (1 - c) ** (2 * self._generation))
        moving = length / settled < (1.4 + 2 / (self._n + 1)) * self._chi
        c = self._c_c
        self._path_c = (1 - c) * self._path_c
        if moving:
            self._path_c += np.sqrt(c * (2 - c) * self._mu) * step
        kept = 1 - self._c_1 - self._c_mu + (0.0 if moving else self._c_1 * c * (2 - c))
        self._C = (
            kept * self._C
            + self._c_1 * np.outer(self._path_c, self._path_c)
            + self._c_mu * (steps.T * self._w) @ steps
        )
        self.sigma *= np.exp(self._c_sigma / self._d_sigma * (length / self._chi - 1))
        squares, self._B = np.linalg.eigh((self._C + self._C.T) / 2)
        self._d = np.sqrt(np.maximum(squares, 1e-20))
