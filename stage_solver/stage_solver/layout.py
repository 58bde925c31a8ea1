"""Arrays per stage in SI units <-> flat vectors of the NLP in solver units (`nlp_functions`)."""

from typing import NamedTuple

import numpy as np

from stage_solver.stage_problem import Bounds, Multipliers, Plan, ProblemError, StageProblem


class Vectors(NamedTuple):
    """Limits of the NLP: v_low <= v <= v_high, g_low <= g(v) <= g_high."""

    v_low: np.ndarray
    v_high: np.ndarray
    g_low: np.ndarray
    g_high: np.ndarray


class Layout:
    """Packs and unpacks for one problem; raises ProblemError when an array has the wrong shape."""

    def __init__(self, problem: StageProblem):
        self.problem = problem
        self.scale_x = np.array(problem.scale_x)
        self.scale_u = np.array(problem.scale_u)

    def check(self, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan) -> None:
        """Raise ProblemError for the first argument whose shape is not that of the problem."""
        N, nx, nu, n_g = self.problem.horizon, self.problem.nx, self.problem.nu, self.problem.ng
        every, before_last = (N + 1, nx), (N, nu)
        limits = [every, every, before_last, before_last, (N, n_g), (N, n_g)]
        limits += [(self.problem.nh,)] * 2
        wanted = {'x0': (x0, (nx,)), 'P': (P, (N + 1, self.problem.np))}
        wanted |= {n: (a, s) for (n, a), s in zip(bounds._asdict().items(), limits)}
        wanted |= {'guess.X': (guess.X, every), 'guess.U': (guess.U, before_last)}
        for name, (array, shape) in wanted.items():
            if np.shape(array) != shape:
                raise ProblemError(f'{name} has shape {np.shape(array)}; {shape} is needed')

    def pack(self, X: np.ndarray, U: np.ndarray) -> np.ndarray:
        """Return v of states (N + 1, nx) and inputs (N, nu)."""
        return self._join(X / self.scale_x, U / self.scale_u)

    def unpack(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return states (N + 1, nx) and inputs (N, nu) of v."""
        X, U = self._part(v)
        return X * self.scale_x, U * self.scale_u

    def pack_bounds(self, x0: np.ndarray, bounds: Bounds) -> Vectors:
        """Return the limits of the NLP; the first state is held at x0."""
        fixed = x0[None, :]
        gap = np.zeros((self.problem.horizon, self.problem.nx))
        return Vectors(
            v_low=self.pack(np.vstack([fixed, bounds.x_low[1:]]), bounds.u_low),
            v_high=self.pack(np.vstack([fixed, bounds.x_high[1:]]), bounds.u_high),
            g_low=np.concatenate([np.hstack([gap, bounds.g_low]).ravel(), bounds.h_low]),
            g_high=np.concatenate([np.hstack([gap, bounds.g_high]).ravel(), bounds.h_high]),
        )

    def unpack_multipliers(self, lam_v: np.ndarray, lam_g: np.ndarray) -> Multipliers:
        """Return the multipliers per SI unit."""
        lam_x, lam_u = self._part(lam_v)
        rows = self.problem.nx + self.problem.ng
        split = self.problem.horizon * rows
        lam_dynamics, g = np.hsplit(lam_g[:split].reshape(-1, rows), [self.problem.nx])
        return Multipliers(
            x=lam_x / self.scale_x,
            u=lam_u / self.scale_u,
            dynamics=lam_dynamics / self.scale_x,
            g=g.copy(),
            h=lam_g[split:].copy(),
        )

    def _join(self, X, U):
        return np.concatenate([np.hstack([X[:-1], U]).ravel(), X[-1]])

    def _part(self, v):
        nx, width = self.problem.nx, self.problem.nx + self.problem.nu
        W = v[: self.problem.horizon * width].reshape(-1, width)
        return np.vstack([W[:, :nx], v[None, -nx:]]), W[:, nx:].copy()
