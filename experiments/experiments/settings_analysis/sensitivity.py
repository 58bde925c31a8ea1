"""What else the tables of a study say: who is lost and how, by outline, which settings count.

None of this enters a verdict.
"""

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from experiments.settings import arms, preconditions
from experiments.settings.preconditions import ACCEPTED
from experiments.settings.primaries import CLAIMS
from experiments.settings_analysis import study_tables
from experiments.settings_analysis.study_tables import Study

STANDING_MPS = 0.1  # least speed of a car that has stopped
ENDS = (
    'avoids',
    'loses control',
    'stops',
    'hits an obstacle',
    'beyond an edge',
    'other',
    'no result',
)


class ByOutline(NamedTuple):
    """How often a claim holds where the outlines of both cars, too, touch nothing."""

    claim: str
    baseline: str
    level: str
    settings: int
    holds: int


def ends(study: Study, arm: str) -> dict[str, int]:
    """Return how the undisturbed drives of an arm end, by the first of ENDS that applies.

    Contact is that of the circles. A car below the least speed of its controller brakes to a stop.
    """
    rows = study.drives[(study.drives['arm'] == arm) & (study.drives['perturbation'] == 0)]
    by = study.plan.preconditions.P2.by
    counts = dict.fromkeys(ENDS, 0)
    for row in rows.to_dict('records'):
        counts[_end(row, by)] += 1
    return counts


def _end(row: dict[str, Any], by: str) -> str:
    if row['error']:
        return 'no result'
    if preconditions.avoids(row, by):
        return 'avoids'
    if row['lost']:
        return 'loses control'
    if row['min_speed_mps'] < STANDING_MPS:
        return 'stops'
    if row['min_v2o_m'] <= 0.0:
        return 'hits an obstacle'
    return 'beyond an edge' if row['min_v2e_m'] <= 0.0 else 'other'


def by_outline(study: Study, baseline: str) -> list[ByOutline]:
    """Return the claims of a version of the baseline at their own levels, outlines clear, too.

    The undisturbed start alone counts.
    """
    plan = study.plan
    own = study.outcomes[study.outcomes['baseline'] == baseline]
    own = own[own['perturbation'] == 0]
    start = study.drives[study.drives['perturbation'] == 0].set_index(['arm', 'setting'])
    clear = (start['min_outline_gap_m'] > 0.0) & (start['outline_edge_m'] > 0.0)
    rows = []
    for claim in CLAIMS:
        level = study_tables.level(plan, claim)
        reached = study_tables.reaching(own, level, plan.decision.from_level)
        numbers = reached['setting'].to_numpy()
        both = [clear.loc[arm].reindex(numbers, fill_value=False) for arm in (arms.MPCC, baseline)]
        holds = reached.loc[np.logical_and(*both).to_numpy(bool), f'{claim}.holds']
        holds = holds.dropna().astype(bool)
        rows.append(ByOutline(claim, baseline, level, len(holds), int(holds.sum())))
    return rows


def marginals(study: Study, baseline: str) -> pd.DataFrame:
    """Return each drawn dimension over all settings and over the accepted ones.

    Quartiles of numbers, the share of each value of choices; columns `dimension`, `value`, `all`,
    `accepted`. Tells which settings the conditional shares are about.
    """
    own = study.outcomes[study.outcomes['baseline'] == baseline]
    reached = study_tables.reaching(own, ACCEPTED, study.plan.decision.from_level)['setting']
    drawn = study_tables.dimensions(study)
    accepted = drawn.loc[drawn.index.isin(reached)]
    rows = []
    for name, values in drawn.items():
        if isinstance(values.iloc[0], (str, bool, np.bool_)) or values.nunique() <= 4:
            kinds = sorted(values.unique(), key=str)
            shares = [
                [float((part == kind).mean()) for part in (values, accepted[name])]
                for kind in kinds
            ]
            rows += [(name, f'share of {kind}', *pair) for kind, pair in zip(kinds, shares)]
        else:
            for quantile in (0.25, 0.5, 0.75):
                pair = [float(part.quantile(quantile)) for part in (values, accepted[name])]
                rows.append((name, f'{quantile:.0%} quantile', *pair))
    return pd.DataFrame(rows, columns=['dimension', 'value', 'all', 'accepted'])
