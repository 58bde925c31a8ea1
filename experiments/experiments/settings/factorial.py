"""Main effects and interactions of a full factorial over matched settings.

With every factor coded -1 (as in the MPCC) and +1 (as in the baseline), the effect of a set of
factors on a response is the mean response where the product of their codes is +1 less that where it
is -1 (Montgomery, "Design and Analysis of Experiments", ch. 6). A full factorial at every setting
gives each setting its own effects, so that their intervals come from resampling settings.
"""

from collections.abc import Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from experiments import statistical_inference

BETWEEN = ' x '  # the factors of an interaction
RESAMPLES, SEED = 4999, 1


class Effect(NamedTuple):
    """The effect of a factor, or of an interaction, on one response."""

    term: str  # the names of the factors, joined by BETWEEN
    order: int  # 1 for a main effect
    settings: int
    mean: float  # over settings, in the unit of the response
    interval: tuple[float, float]  # of 95 %, by the bootstrap (BCa) over settings
    p_value: float
    p_adjusted: float  # by Holm's method over the terms of this response


def terms(factors: Sequence[str]) -> list[tuple[str, ...]]:
    """Return every non-empty set of factors, main effects first."""
    orders = range(1, len(factors) + 1)
    return [chosen for order in orders for chosen in combinations(factors, order)]


def complete_settings(drives: pd.DataFrame, factors: Sequence[str], response: str) -> pd.DataFrame:
    """Return the response as (settings, combinations) with NaN-free rows only.

    `drives` has the columns `setting`, one bool column per factor, and the response; repeated rows
    of a combination (perturbations) are averaged by their median. The columns are the combinations
    of the factors, in the order of itertools.product((False, True), ...).
    """
    wide = drives.pivot_table(
        index='setting', columns=list(factors), values=response, aggfunc='median'
    )
    combinations_ = list(product((False, True), repeat=len(factors)))
    if len(factors) == 1:
        combinations_ = [key[0] for key in combinations_]
    return wide.reindex(columns=combinations_).dropna()


def setting_effects(wide: pd.DataFrame, factors: Sequence[str]) -> pd.DataFrame:
    """Return the effects by setting, (settings, terms), from a table of `complete_settings`."""
    codes = np.array(list(product((-1.0, 1.0), repeat=len(factors))))
    values = wide.to_numpy(float)
    effects = {}
    for chosen in terms(factors):
        columns = [list(factors).index(name) for name in chosen]
        contrast = codes[:, columns].prod(axis=1)
        effects[BETWEEN.join(chosen)] = values @ contrast / (len(codes) / 2)
    return pd.DataFrame(effects, index=wide.index)


def analyse(drives: pd.DataFrame, factors: Sequence[str], response: str) -> list[Effect]:
    """Return the effects of every term on a response, main effects first.

    Settings at which a combination has no value are left out; [] when none is left. The p-values
    are those of Wilcoxon's signed-rank test over settings.
    """
    wide = complete_settings(drives, factors, response)
    if wide.empty:
        return []
    effects = setting_effects(wide, factors)
    p_values = {name: _p_value(effects[name]) for name in effects}
    adjusted = statistical_inference.holm(p_values)
    return [
        Effect(
            term=name,
            order=name.count(BETWEEN) + 1,
            settings=len(effects),
            mean=float(effects[name].mean()),
            interval=_mean_interval(effects[name].to_numpy()),
            p_value=p_values[name],
            p_adjusted=adjusted[name],
        )
        for name in effects
    ]


def _p_value(values):
    return float(stats.wilcoxon(values).pvalue) if np.any(values) else 1.0


def _mean_interval(values):
    if np.ptp(values) <= 1e-9 * np.max(np.abs(values)):  # BCa is undefined without any spread
        return float(values.min()), float(values.max())
    rng = np.random.default_rng(SEED)
    resampled = stats.bootstrap((values,), np.mean, n_resamples=RESAMPLES, batch=1000, rng=rng)
    return tuple(map(float, resampled.confidence_interval))
