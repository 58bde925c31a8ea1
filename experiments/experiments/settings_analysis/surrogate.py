"""What drives an outcome: a regression over the settings' dimensions and its Sobol' indices.

The regression is fitted to the settings at which both cars were driven. Its indices are those of a
model, so they are given only where the model predicts settings that it has not seen, and they
belong to independent inputs over the whole ranges, while a precondition makes the inputs of the
accepted settings dependent. The permutation importance, on held-out settings, has no such
assumption and is given beside them.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import rankdata

LEAST_SCORE = 0.25  # cross-validated share of the variance, below it there is no surrogate
LEAST_SETTINGS = 60
FOLDS, REPEATS = 5, 2
BASE_SAMPLES = 1024  # of Saltelli's scheme, a power of two
SEED = 1


class Driver(NamedTuple):
    """What one dimension contributes to the variance of an outcome."""

    dimension: str
    first: float  # first-order Sobol' index
    first_interval: float  # half width at 95 %
    total: float  # total Sobol' index
    total_interval: float
    permutation: float  # fall of the score on held-out settings


class Surrogate(NamedTuple):
    """A regression of one outcome."""

    outcome: str
    settings: int
    model: str
    score: float | None  # cross-validated R^2; None with fewer than LEAST_SETTINGS settings
    score_spread: float | None  # standard deviation over the repeats
    drivers: tuple[Driver, ...]  # by falling total index; () where there is no surrogate

    @property
    def is_usable(self) -> bool:
        """Whether the drivers were computed."""
        return bool(self.drivers)


def unit_features(settings: pd.DataFrame, dimensions: Sequence[str]) -> pd.DataFrame:
    """Return the dimensions as numbers in (0, 1): the quantile of each value among all settings.

    Over settings drawn from independent distributions the quantiles are uniform and independent,
    which is what the Sobol' indices assume. Equal values, as of a choice, share their mean rank;
    text is ranked in alphabetical order.
    """
    columns = {}
    for name in dimensions:
        values = settings[name]
        if not pd.api.types.is_numeric_dtype(values):
            values = pd.Categorical(values.astype(str)).codes
        columns[name] = (rankdata(np.asarray(values, dtype=float)) - 0.5) / len(settings)
    return pd.DataFrame(columns, index=settings.index)


def fit(features: pd.DataFrame, outcome: pd.Series) -> Surrogate:
    """Return the surrogate of an outcome over settings of the same index; NaN are left out.

    `features` are those of `unit_features`. Of gradient boosting and a ridge regression on all
    products of two dimensions the one with the better score is kept; the score reported is computed
    on other folds than the choice.
    """
    from sklearn.inspection import permutation_importance
    from sklearn.model_selection import train_test_split

    known = outcome.dropna().index
    X, y = features.loc[known], outcome.loc[known].to_numpy(float)
    name = str(outcome.name)
    if len(known) < LEAST_SETTINGS or np.ptp(y) == 0.0:
        return Surrogate(name, len(known), 'none', None, None, ())
    chosen = max(MODELS, key=lambda kind: _scores(MODELS[kind], X, y, [SEED])[0])
    scores = _scores(MODELS[chosen], X, y, [SEED + 1 + k for k in range(REPEATS)])
    score, spread = float(np.mean(scores)), float(np.std(scores))
    if score < LEAST_SCORE:
        return Surrogate(name, len(known), chosen, score, spread, ())
    train_X, test_X, train_y, test_y = train_test_split(X, y, random_state=SEED)
    held_out = permutation_importance(
        MODELS[chosen]().fit(train_X, train_y), test_X, test_y, n_repeats=10, random_state=SEED
    )
    indices = _sobol_indices(MODELS[chosen]().fit(X, y), list(features.columns))
    drivers = [
        Driver(name, *row, float(permuted))
        for name, row, permuted in zip(features.columns, indices, held_out.importances_mean)
    ]
    drivers.sort(key=lambda driver: -driver.total)
    return Surrogate(name, len(known), chosen, score, spread, tuple(drivers))


def _scores(build, X, y, seeds):
    """Return the R^2 of predictions for settings that were left out, one per seed of the folds."""
    from sklearn.metrics import r2_score
    from sklearn.model_selection import KFold, cross_val_predict

    return [
        r2_score(y, cross_val_predict(build(), X, y, cv=KFold(FOLDS, shuffle=True, random_state=k)))
        for k in seeds
    ]


def _sobol_indices(model, names):
    """Return rows of first-order and total index with their half widths, one per name."""
    from SALib.analyze import sobol as analyse
    from SALib.sample import sobol as sample

    problem = {'num_vars': len(names), 'names': names, 'bounds': [[0.0, 1.0]] * len(names)}
    points = sample.sample(problem, BASE_SAMPLES, calc_second_order=False, seed=SEED)
    values = model.predict(pd.DataFrame(points, columns=names))
    indices = analyse.analyze(problem, values, calc_second_order=False, seed=SEED)
    columns = (indices[key] for key in ('S1', 'S1_conf', 'ST', 'ST_conf'))
    return [tuple(map(float, row)) for row in zip(*columns)]


def _boosting():
    from sklearn.ensemble import GradientBoostingRegressor

    # not the one on histograms: its threads slow each other down on a busy machine
    return GradientBoostingRegressor(
        n_estimators=120, max_depth=3, learning_rate=0.08, subsample=0.7, random_state=0
    )


def _quadratic():
    from sklearn.linear_model import RidgeCV
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import PolynomialFeatures, StandardScaler

    return make_pipeline(StandardScaler(), PolynomialFeatures(2), RidgeCV(np.logspace(-1, 4, 11)))


MODELS: Mapping[str, Any] = {'gradient boosting': _boosting, 'quadratic ridge': _quadratic}
