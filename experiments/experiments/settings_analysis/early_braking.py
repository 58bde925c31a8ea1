"""When the MPCC brakes before obstacle 2, when earlier than a baseline, and what comes with it.

Hard braking by a converged plan before obstacle 2, as P4 has it, in undisturbed drives. Settings at
a level: those that meet its conditions from P1 on.
"""

from typing import Any

import numpy as np
import pandas as pd

from experiments.settings import arms
from experiments.settings_analysis import decide, dimension_shares, setting_statistics, study_tables
from experiments.settings_analysis.study_tables import Study

ONSET = 'brake_onset_planned_at_m'
WHO = ('MPCC earlier', 'equal', 'MPCC later', 'MPCC alone', 'baseline alone', 'none')
BESIDE = ('min_speed', 'sideslip', 'unsafe_area')  # claims whose differences are compared
BASELINES = (arms.MATCHED, arms.LINEAGE)


def compare(study: Study, baseline: str, level: str) -> pd.DataFrame:
    """Return who brakes in each setting at a level, and the differences beside it.

    Columns: `who`, one of WHO, where onsets within the margin are equal; `earlier_m`, by how much
    the MPCC brakes earlier, NaN where not both brake; the differences of BESIDE.
    """
    own = study.outcomes[
        (study.outcomes['baseline'] == baseline) & (study.outcomes['perturbation'] == 0)
    ]
    own = study_tables.reaching(own, level, decide.ANY_S).set_index('setting')
    brakes = {arm: onsets(study, arm).reindex(own.index).notna() for arm in (arms.MPCC, baseline)}
    mpcc, other = brakes[arms.MPCC], brakes[baseline]
    earlier = own['brake_onset.difference'].astype(float)
    margin = study_tables.margin(study.plan, 'brake_onset')
    conditions = [
        mpcc & other & (earlier > margin),
        mpcc & other & (earlier.abs() <= margin),
        mpcc & other & (earlier < -margin),
        mpcc & ~other,
        ~mpcc & other,
    ]
    beside = {claim: own[f'{claim}.difference'].astype(float) for claim in BESIDE}
    return pd.DataFrame(
        {'who': np.select(conditions, WHO[:-1], WHO[-1]), 'earlier_m': earlier, **beside}
    )


def onsets(study: Study, arm: str) -> pd.Series:
    """Return the station of the onset of an arm by setting [m], NaN where it does not brake."""
    rows = study.drives[(study.drives['arm'] == arm) & (study.drives['perturbation'] == 0)]
    return rows.set_index('setting')[ONSET].astype(float)


def brakes_where_it_avoids(study: Study) -> dict[str, pd.Series]:
    """Return by arm whether it brakes, in the settings in which MPCC and `frenet_matched` avoid."""
    own = study.outcomes[study.outcomes['baseline'] == arms.MATCHED]
    reached = study_tables.reaching(own, decide.DRIVER_LEVEL, decide.ANY_S)['setting'].unique()
    return {arm: onsets(study, arm).reindex(reached).notna() for arm in (arms.MPCC, arms.MATCHED)}


def summarise(study: Study) -> dict[str, Any]:
    """Return the counts as braking.json has them; what makes cars brake only without screening."""
    earlier_m = study.plan.primaries.brake_onset.earlier_m
    summary = {
        'run': study.run,
        'earlier_m': earlier_m,
        'margin_m': study_tables.margin(study.plan, 'brake_onset'),
        'pairs': [
            _pair(study, baseline, level, earlier_m)
            for baseline in study.baselines
            if baseline in BASELINES
            for level in study.levels
            if level < 'P4'
        ],
    }
    if study.is_screened or arms.MATCHED not in study.baselines:
        return summary
    brakes = brakes_where_it_avoids(study)
    drawn = study_tables.dimensions(study)
    return summary | {
        'brakes': {arm: dimension_shares.share(values) for arm, values in brakes.items()},
        'by_dimension': dimension_shares.by_dimension(drawn, brakes),
    }


def _pair(study, baseline, level, earlier_m):
    table = compare(study, baseline, level)
    lead = table['earlier_m'].dropna()
    return {
        'baseline': baseline,
        'level': level,
        'settings': len(table),
        'both': len(lead),
        'earlier': int((lead >= earlier_m).sum()),
        'later': int((lead <= -earlier_m).sum()),
        'lead_m': _median(lead),
        'who': [
            {'who': who, 'settings': len(part)} | {claim: _median(part[claim]) for claim in BESIDE}
            for who, part in ((who, table[table['who'] == who]) for who in WHO)
        ],
    }


def _median(values):
    """Return median and interval of the values, None without two of them."""
    known = values.dropna().to_numpy(float)
    if len(known) < 2:
        return None
    return [float(np.median(known)), *setting_statistics.median_interval(known)]
