"""In which settings each controller avoids both obstacles: the phase diagram of the study.

Settings count in which the car without collision avoidance hits obstacle 1 (P1) and all controllers
drove, undisturbed. Avoiding is the controller's part of P2: it completes under control, and its
circles touch no obstacle and no edge.
"""

from typing import Any, NamedTuple

import pandas as pd
from scipy.stats import binomtest

from experiments.settings import arms, preconditions
from experiments.settings_analysis import dimension_shares, study_tables
from experiments.settings_analysis.decide import ANY_S
from experiments.settings_analysis.study_tables import Study

LATENCY = 'latency_ms'
COMPARED = (arms.MPCC, arms.MATCHED, arms.LINEAGE)


class Avoidance(NamedTuple):
    """Who avoids, by setting."""

    drawn: pd.DataFrame  # the dimensions
    avoids: pd.DataFrame  # a bool column per controller

    def __repr__(self) -> str:
        return f'Avoidance({len(self.avoids)} settings)'


def find(study: Study) -> Avoidance:
    """Return who avoids in the settings of a study at P1. Needs a study that is not screened."""
    start = study.drives[(study.drives['perturbation'] == 0) & (study.drives['error'] == '')]
    reached = study_tables.reaching(study.outcomes, ANY_S, ANY_S)['setting'].unique()
    by = study.plan.preconditions.P2.by
    columns = {}
    for arm in COMPARED:
        rows = start[start['arm'] == arm].set_index('setting')
        columns[arm] = pd.Series(
            [preconditions.avoids(row, by) for row in rows.to_dict('records')], rows.index, bool
        )
    avoids = pd.DataFrame(columns).reindex(reached).dropna().astype(bool).sort_index()
    return Avoidance(study_tables.dimensions(study).loc[avoids.index], avoids)


def summarise(study: Study) -> dict[str, Any]:
    """Return the counts as avoidance.json has them."""
    drawn, avoids = find(study)
    strata = study_tables.strata(study).loc[avoids.index]
    return {
        'run': study.run,
        'settings': len(avoids),
        'drawn': study.settings,
        'strata_S': list(study.plan.strata.S),
        'all': {arm: dimension_shares.share(avoids[arm]) for arm in COMPARED},
        'by_latency_and_S': [
            {
                'latency_ms': int(latency),
                'arm': arm,
                'all': dimension_shares.share(part[arm]),
                'strata': [
                    dimension_shares.share(cell)
                    for _, cell in part[arm].groupby(strata, observed=False)
                ],
            }
            for arm in COMPARED
            for latency, part in avoids.groupby(drawn[LATENCY])
        ],
        'paired': [_paired(avoids, other) for other in COMPARED[1:]],
        'by_dimension': dimension_shares.by_dimension(drawn, dict(avoids.items())),
    }


def _paired(avoids, other):
    mpcc, baseline = avoids[arms.MPCC], avoids[other]
    alone, other_alone = int((mpcc & ~baseline).sum()), int((~mpcc & baseline).sum())
    differ = alone + other_alone
    return {
        'baseline': other,
        'both': int((mpcc & baseline).sum()),
        'mpcc_alone': alone,
        'baseline_alone': other_alone,
        'none': int((~mpcc & ~baseline).sum()),
        'p_value': float(binomtest(alone, differ).pvalue) if differ else 1.0,
    }
