"""Which unprinted parameters make the paper's picture: approximate Bayesian computation.

Prior: the tasks of the study, and weights of MPCC and baseline that are drawn apart, each logarithm
uniform over the range of the search. Of all draws the nearest to the picture are the sample of the
posterior (rejection; Pritchard et al. 1999, doi 10.1093/oxfordjournals.molbev.a026091). A draw is
driven by the baseline where the MPCC shows its part of the picture.
"""

from collections.abc import Mapping
from random import Random
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import false_discovery_control, ks_2samp

from experiments.families.lane_change_task import UNIFORM
from experiments.tuned_study import arms
from experiments.tuned_study.arms import COMPARED, Driver

# of a task, beside weights
PARAMETERS = ('S', 'speed_mps', 'latency_ms', 'rear_cornering', 'roll_share', *UNIFORM)
SLACK_M = 0.02  # a distance that lacks no more counts as kept


class Marginal(NamedTuple):
    """One parameter: its quartiles before and after, and whether they differ."""

    name: str
    prior: tuple[float, float, float]
    posterior: tuple[float, float, float]
    shares: tuple[float, float, float]  # of the prior, below the quartiles of the posterior
    p_value: float  # Kolmogorov-Smirnov, adjusted by Benjamini and Hochberg over all parameters


def drive(plan: Mapping[str, Any], driver: Driver) -> None:
    """Drive as many draws as the plan allows; their table is that of the driver's lines."""
    rules, seed = plan['picture'], plan['seeds']['picture']

    def rows(arm, indices):
        ranges = {name: plan['search']['ranges'][name] for name in arms.tuned_parameters(plan, arm)}
        for index in indices:
            random = Random(f'{arm} {seed} {index}')
            chosen = {
                name: low * (high / low) ** random.random() for name, (low, high) in ranges.items()
            }
            labels = (*chosen.items(), *arms.task_values(seed, index).items())
            parameters = arms.settings(plan, arm, {arm: chosen})
            yield arms.row(plan, arm, parameters, seed, index, labels=labels)

    begin = 0
    while len(driver.lines) < rules['drives']:
        indices = range(begin, begin + rules['batch'])
        own = driver.drive([*rows('mpcc', indices)])
        shown = [
            index
            for index, values in zip(indices, own)
            if values['avoided'] and values['kept_m'] >= -SLACK_M
        ]
        driver.drive([*rows('frenet', shown)])
        begin += rules['batch']


def distances(drives: pd.DataFrame, rules: Mapping[str, Any]) -> pd.Series:
    """Return the distance of each draw from the picture, by its task, ascending.

    The root of the sum of squares of what an item misses over its scale, at most `cap` each; what
    has no value misses it by `cap`.
    """
    mpcc, baseline = (drives[drives['arm'] == arm].set_index('task') for arm in COMPARED)
    mpcc = mpcc.loc[baseline.index]
    items = pd.DataFrame(
        {
            'baseline_avoids': baseline['avoided'].astype(float),
            'baseline_kept_m': baseline['kept_m'],
            'mpcc_sideslip_deg': mpcc['peak_sideslip_deg'],
            'baseline_sideslip_deg': baseline['peak_sideslip_deg'],
            'onset_lead_m': baseline['brake_onset_m'] - mpcc['brake_onset_m'],
            'speed_gain_mps': mpcc['min_speed_mps'] - baseline['min_speed_mps'],
        }
    )
    missing = pd.DataFrame(index=items.index)
    for name, (least, most, scale) in rules['items'].items():
        beyond = np.maximum(least - items[name], items[name] - most).clip(lower=0.0) / scale
        missing[name] = beyond.fillna(rules['cap']).clip(upper=rules['cap'])
    return np.sqrt((missing**2).sum(axis=1)).sort_values()


def marginals(drives: pd.DataFrame, rules: Mapping[str, Any]) -> list[Marginal]:
    """Return every parameter before and after, those that differ most first.

    None where no MPCC of the draws shows its part of the picture.
    """
    nearest = distances(drives, rules).index[: rules['nearest']]
    if nearest.empty:
        return []
    rows = []
    for arm in COMPARED:
        own = drives[drives['arm'] == arm].set_index('task')
        # the prior of the baseline's weights: those of tasks alone depend on what the MPCC showed
        names = [name for name in own if name.startswith(('tolerances.', 'priorities.'))]
        if arm == COMPARED[0]:
            names += [name for name in PARAMETERS if name in own]
        for name in names:
            before, after = own[name], own.loc[nearest, name]
            if before.notna().all():
                p_value = float(ks_2samp(before, after).pvalue)
                label = f'{arm} {name}' if '.' in name else name
                quartiles = [tuple(np.quantile(v, (0.25, 0.5, 0.75))) for v in (before, after)]
                shares = tuple(float((before < value).mean()) for value in quartiles[1])
                rows.append(Marginal(label, *quartiles, shares, p_value))
    adjusted = false_discovery_control([row.p_value for row in rows])
    rows = [row._replace(p_value=float(p)) for row, p in zip(rows, adjusted)]
    return sorted(rows, key=lambda row: row.p_value)
