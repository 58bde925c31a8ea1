"""How often something happens in the quarters of each drawn dimension, or for each choice."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from experiments.statistical_inference import wilson_interval

QUARTERS = 4


def share(holds: pd.Series) -> dict[str, Any]:
    """Return `holds`, `of`, and Wilson's interval of 95 % of the share as `low` and `high`."""
    known = holds.dropna().astype(bool)
    low, high = wilson_interval(int(known.sum()), len(known))
    return {'holds': int(known.sum()), 'of': len(known), 'low': low, 'high': high}


def by_dimension(drawn: pd.DataFrame, happens: Mapping[str, pd.Series]) -> list[dict[str, Any]]:
    """Return an entry per dimension, the one over which the first share varies most at the top.

    `drawn` has the values by setting, `happens` truths by setting under names. An entry has the
    `dimension`, its `groups` as text (quarters of equal counts among the settings of `happens`, or
    the choices), and under each name the `share` of each group.
    """
    known = drawn.loc[next(iter(happens.values())).index]
    entries = []
    for name, values in known.items():
        groups = _groups(values)
        entry = {'dimension': name, 'groups': [_text(level) for level in groups.cat.categories]}
        for key, holds in happens.items():
            parts = holds.groupby(groups, observed=False)
            entry[key] = [share(part) for _, part in parts]
        entries.append(entry)
    first = next(iter(happens))
    return sorted(entries, key=lambda entry: -_range(entry[first]))


def _groups(values):
    if pd.api.types.is_numeric_dtype(values) and values.nunique() > QUARTERS:
        return pd.qcut(values.astype(float), QUARTERS).cat.remove_unused_categories()
    return values.astype('category')


def _text(level):
    if isinstance(level, pd.Interval):
        return f'{_number(level.left)} to {_number(level.right)}'
    return str(level).removesuffix('.yaml')


def _number(value):
    return f'{value:,.0f}' if abs(value) >= 1000.0 else f'{value:.3g}'


def _range(shares):
    values = [group['holds'] / group['of'] for group in shares if group['of']]
    return float(np.ptp(values)) if values else 0.0
