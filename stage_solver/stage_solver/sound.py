"""Are the numbers of a solve usable? Solvers may hang or crash on the ones that are not."""

import numpy as np

from stage_solver.stage_problem import Bounds, Plan, StageProblem


def complaint(
    problem: StageProblem, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan
) -> str:
    """Return what is wrong with the arguments of a solve, '' when nothing is."""
    named = (
        ('the initial state', x0[None, :], problem.states),
        ('the parameters', P, problem.parameters),
        ('the guess', guess.X[1:], problem.states),
        ('the guess', guess.U, problem.inputs),
    )
    for what, array, names in named:
        bad = np.argwhere(~np.isfinite(array))
        if bad.size:
            stage, i = bad[0]
            return f'{what} is not finite: {names[i]} = {array[stage, i]}, row {stage}'
    for kind in ('x', 'u', 'g', 'h'):
        low, high = getattr(bounds, f'{kind}_low'), getattr(bounds, f'{kind}_high')
        if kind == 'x':
            low, high = low[1:], high[1:]
        # a limit that is NaN is neither, so the negation catches it too
        bad = np.argwhere(~((low <= high) & (low < np.inf) & (high > -np.inf)))
        if bad.size:
            at = tuple(bad[0])
            return f'no value of {kind}{list(map(int, at))} lies in [{low[at]}, {high[at]}]'
    return ''


def blow_up(problem: StageProblem, f: float, g: np.ndarray, slope: np.ndarray) -> str:
    """Return where the problem's functions are not finite at the guess, '' when they all are.

    f, g and slope are cost, constraints and gradient of the NLP (see `nlp_functions`).
    """
    for what, values, rows in (
        ('the constraints are', g, problem.nx + problem.ng),
        ('the gradient is', slope, problem.nx + problem.nu),
    ):
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            stage = min(bad[0] // rows, problem.horizon)
            return f'{what} not finite at stage {stage} of the guess'
    return '' if np.isfinite(f) else 'the cost of the guess is not finite'
