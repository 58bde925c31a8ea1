"""The share in which a condition holds, as a smooth function of two columns, with an interval.

Logistic regression on polynomials of the two columns, of the degree that predicts drives best that
it was not fitted to (cross-validation, log loss). The interval is that of the bootstrap, resampled
by draw: it holds for the form that was fitted, not for what a polynomial cannot follow.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bags.errors import BagError

DEGREES = (1, 2, 3)
FOLDS = 5
RESAMPLES, SEED = 200, 0
CONFIDENCE = 0.95
GRID = 61  # points per column
PENALTY = 10.0  # inverse strength: weak, but holds where the two outcomes can be separated
LEAST = 20  # drives


class Surface(NamedTuple):
    """A share over a grid; rows are the second column, columns the first."""

    x: np.ndarray  # (GRID,)
    y: np.ndarray  # (GRID,)
    share: np.ndarray  # (GRID, GRID)
    low: np.ndarray  # likewise, of the interval
    high: np.ndarray
    degree: int
    skill: float  # share of the log loss of a constant that is gained on unseen drives, at most 1


def fit(x: np.ndarray, y: np.ndarray, holds: np.ndarray, units: Sequence) -> Surface:
    """Return the surface of truths at points; drives of one unit are resampled together.

    Raises BagError for fewer than 20 drives or two units, and where the condition holds, or fails,
    in all but a few: there is nothing to fit.
    """
    points, holds = np.column_stack([x, y]).astype(float), np.asarray(holds, bool)
    codes = np.unique(np.asarray([str(unit) for unit in units]), return_inverse=True)[1]
    rarest = min(holds.sum(), len(holds) - holds.sum())
    if len(holds) < LEAST or rarest < FOLDS:
        raise BagError(
            f'{holds.sum()} of {len(holds)} drives fulfil the condition; a surface needs '
            f'{LEAST} drives, and {FOLDS} that do and that do not'
        )
    if codes.max() < 1:
        raise BagError('the drives share one draw or run; a surface needs at least two')
    skills = [_skill(points, holds, codes, degree) for degree in DEGREES]
    degree = DEGREES[int(np.argmax(skills))]
    axes = [np.linspace(column.min(), column.max(), GRID) for column in points.T]
    grid = np.column_stack([part.ravel() for part in np.meshgrid(*axes)])
    share = _fit(points, holds, degree).predict_proba(grid)[:, 1]
    low, high = _interval(points, holds, codes, degree, grid)
    shaped = (part.reshape(GRID, GRID) for part in (share, low, high))
    return Surface(*axes, *shaped, degree, max(skills))


def _fit(points, holds, degree):
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import PolynomialFeatures, StandardScaler

    model = make_pipeline(
        StandardScaler(),
        PolynomialFeatures(degree, include_bias=False),
        LogisticRegression(C=PENALTY, max_iter=1000),
    )
    return model.fit(points, holds)


def _skill(points, holds, codes, degree):
    """Return how much of the log loss of the mean is gained on drives that were left out."""
    from sklearn.metrics import log_loss
    from sklearn.model_selection import GroupKFold

    predicted, constant = np.empty(len(holds)), np.empty(len(holds))
    folds = GroupKFold(min(FOLDS, len(np.unique(codes)))).split(points, holds, codes)
    for rest, left_out in folds:
        constant[left_out] = np.clip(holds[rest].mean(), 1e-3, 1 - 1e-3)
        if np.unique(holds[rest]).size < 2:
            predicted[left_out] = constant[left_out]
            continue
        model = _fit(points[rest], holds[rest], degree)
        predicted[left_out] = model.predict_proba(points[left_out])[:, 1]
    return 1.0 - log_loss(holds, predicted) / log_loss(holds, constant)


def _interval(points, holds, codes, degree, grid):
    rng = np.random.default_rng(SEED)
    members = [np.flatnonzero(codes == code) for code in range(codes.max() + 1)]
    shares = []
    while len(shares) < RESAMPLES:
        chosen = rng.integers(len(members), size=len(members))
        rows = np.concatenate([members[code] for code in chosen])
        if np.unique(holds[rows]).size == 2:
            shares.append(_fit(points[rows], holds[rows], degree).predict_proba(grid)[:, 1])
    tail = 100 * (1 - CONFIDENCE) / 2
    return np.percentile(shares, [tail, 100 - tail], axis=0)
