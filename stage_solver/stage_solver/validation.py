"""Checks of the arguments of a solve: shapes, finite values, bounds that contain a value.

Solvers may hang or crash on values that are not finite.
"""

import numpy as np

from stage_solver.stage_problem import Bounds, Plan, ProblemError, StageProblem


def check_shapes(
    problem: StageProblem, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan
) -> None:
    """Raise ProblemError for the first argument whose shape does not fit the problem."""
    arrays = {'x0': x0, 'P': P} | bounds._asdict() | {'guess.X': guess.X, 'guess.U': guess.U}
    for name, array in arrays.items():
        shape = problem.shapes[name.removeprefix('guess.')]
        if np.shape(array) != shape:
            raise ProblemError(f'{name} has shape {np.shape(array)}; {shape} is needed')


def find_invalid_argument(
    problem: StageProblem, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan
) -> str:
    """Return a message about the first invalid value in the arguments of a solve, '' if none."""
    arguments = (
        ('the initial state', x0[None, :], problem.states),
        ('the parameters', P, problem.parameters),
        ('the guess', guess.X[1:], problem.states),
        ('the guess', guess.U, problem.inputs),
    )
    for label, array, names in arguments:
        bad = np.argwhere(~np.isfinite(array))
        if bad.size:
            stage, i = bad[0]
            return f'{label} is not finite: {names[i]} = {array[stage, i]}, row {stage}'
    for kind in ('x', 'u', 'g', 'h'):
        low, high = getattr(bounds, f'{kind}_low'), getattr(bounds, f'{kind}_high')
        if kind == 'x':
            low, high = low[1:], high[1:]
        # NaN fails every comparison, so the negation finds it too
        bad = np.argwhere(~((low <= high) & (low < np.inf) & (high > -np.inf)))
        if bad.size:
            at = tuple(bad[0])
            return f'no value of {kind}{list(map(int, at))} lies in [{low[at]}, {high[at]}]'
    return ''
