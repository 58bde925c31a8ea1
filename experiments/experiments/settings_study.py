"""Every published share of the first study over settings, from the rows that are kept of it.

The drives of the accepted settings are in accepted_drives.parquet, with the file that fixed the
study beforehand in the metadata. Its preconditions of a setting, for a version of the baseline:

P1  without collision avoidance the car's circle touches obstacle 1
P2  MPCC and baseline complete, are not lost, and touch neither obstacle nor edge
P3  all three reach the lateral limit of the plant
P4  MPCC and baseline brake hard before obstacle 2

A setting counts for a claim when its undisturbed drives meet the conditions from P1 to the claim's
level. It holds when the claim holds in most of its five starts, and is undetermined when they
disagree, or when one of them does not tell: a car is not at P2, or does not brake.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import yaml

from bags.errors import BagError
from experiments.statistical_inference import bootstrap_interval, wilson_interval

FILE = Path('confirmatory', 'accepted_drives.parquet')
# controllers of the rows: the paper's MPCC, the same without collision avoidance, and the baseline
# with the MPCC's tolerances or with tolerances, circles and brake split of its lineage's open code
MPCC, NO_CA, MATCHED, LINEAGE = 'mpcc', 'mpcc_no_ca', 'frenet_matched', 'frenet_lineage'
CONDITIONS = ('P1', 'P2', 'P3', 'P4')
CLAIMS = ('unsafe_area', 'sideslip', 'brake_onset', 'min_speed', 'conjunction')
ONSET = 'brake_onset_planned_at_m'
RESAMPLES, SEED = 4999, 1


class Study(NamedTuple):
    """The kept rows, and what was fixed before they were driven."""

    rules: dict[str, Any]
    drives: pd.DataFrame  # by arm, setting and perturbation


def read(folder: Path) -> Study:
    """Return the rows that are kept in a folder. Raises BagError where they are not there."""
    from pyarrow import ArrowException, parquet

    try:
        table = parquet.read_table(folder / FILE)
        rules = yaml.safe_load(table.schema.metadata[b'preregistration'])
    except (OSError, ArrowException, LookupError, TypeError) as error:
        raise BagError(f'{folder / FILE}: holds no rows of the study: {error}') from None
    return Study(rules, table.to_pandas().set_index(['arm', 'setting', 'perturbation']))


def reaching(study: Study, baseline: str, level: str) -> pd.Index:
    """Return the settings whose undisturbed drives meet the conditions from P1 to a level."""
    least = study.rules['preconditions']['P3']['least_limit_share']
    undisturbed = study.drives.xs(0, level='perturbation')
    no_ca, mpcc, other = (undisturbed.loc[arm] for arm in (NO_CA, MPCC, baseline))
    met = {
        'P1': no_ca['v2o_1_m'] < 0.0,
        'P2': _avoids(mpcc) & _avoids(other),
        'P3': pd.concat([no_ca, mpcc, other])['limit_share'].groupby('setting').min() >= least,
        'P4': mpcc[ONSET].notna() & other[ONSET].notna(),
    }
    needed = CONDITIONS[: CONDITIONS.index(level) + 1]
    return no_ca.index[pd.DataFrame(met)[[*needed]].all(axis=1)]


def _avoids(drives):
    gaps = drives[['min_v2o_m', 'min_v2e_m']]
    return drives['completed'] & ~drives['lost'] & (gaps > 0.0).all(axis=1)


def shares(study: Study) -> pd.DataFrame:
    """Return every claim at its level, from each version of the baseline; intervals are of 95 %.

    low, high        Wilson's, of the share of settings in which the claim holds
    low_if_none ...  the same where what is undetermined does not hold, and where it does (if_all)
    undetermined     settings; silent: of these with a start that does not tell
    median           difference in the paper's direction with its percentile bootstrap interval, NaN
                     of a claim without one
    """
    rows = []
    for baseline in (MATCHED, LINEAGE):
        mpcc, other = (study.drives.loc[arm] for arm in (MPCC, baseline))
        mpcc = mpcc.loc[other.index]
        differences, holds = _judge(study.rules['primaries'], mpcc, other)
        tells = _avoids(mpcc) & _avoids(other)
        for claim in CLAIMS:
            counted = reaching(study, baseline, study.rules['primaries'][claim]['level'])
            starts = pd.DataFrame({'difference': differences[claim], 'holds': holds[claim]})
            starts = starts.where(tells).loc[counted].groupby('setting')
            rows.append(_share(baseline, claim, starts, study.rules['decision']))
    return pd.DataFrame(rows)


def _judge(rules, mpcc, other):
    """Return the differences of every start in the paper's direction, and which have its size.

    Frames with a column per claim; the second has 1, 0, or NaN where nothing is known, as of a car
    that does not brake.
    """
    kept, other_kept = (
        np.minimum(
            drives['min_v2o_m'] - drives['safety_obstacle_m'],
            drives['min_v2e_m'] - drives['safety_edge_m'],
        )
        for drives in (mpcc, other)
    )
    slip, other_slip = mpcc['peak_sideslip_deg'], other['peak_sideslip_deg']
    differences = pd.DataFrame(
        {
            'unsafe_area': kept - other_kept,
            'sideslip': other_slip - slip,
            'brake_onset': other[ONSET] - mpcc[ONSET],
            'min_speed': mpcc['min_speed_mps'] - other['min_speed_mps'],
        }
    )
    allowed, sideslip = -rules['unsafe_area']['slack_m'], rules['sideslip']
    holds = pd.DataFrame(
        {
            'unsafe_area': (other_kept < allowed) & (allowed <= kept),
            'sideslip': (other_slip >= sideslip['baseline_deg']) & (slip <= sideslip['mpcc_deg']),
            'brake_onset': differences['brake_onset'] >= rules['brake_onset']['earlier_m'],
            'min_speed': differences['min_speed'] >= rules['min_speed']['higher_mps'],
        }
    )
    holds = holds.astype(float).where(differences.notna())
    # one claim that fails decides the conjunction, whatever is not known of the others
    decided = holds.notna().all(axis=1) | (holds == 0.0).any(axis=1)
    together = holds.min(axis=1).where(decided)
    return differences.assign(conjunction=np.nan), holds.assign(conjunction=together)


def _share(baseline, claim, starts, rule):
    known = starts['holds'].agg(['mean', 'count', 'size']).query('count > 0')
    holds = known['mean'] > 0.5
    silent = known['count'] < known['size']
    undetermined = silent | known['mean'].between(0.0, 1.0, inclusive='neither')
    counts = (holds.sum(), (holds & ~undetermined).sum(), (holds | undetermined).sum())
    share, if_none, if_all = (wilson_interval(int(count), len(holds)) for count in counts)
    # what holds however undetermined settings are counted
    verdict = 'open'
    if if_none[0] > rule['holds_from']:
        verdict = 'reproduced'
    elif if_all[1] < rule['rare_below']:
        verdict = 'not reproduced'
    elif if_none[0] > rule['rare_below'] and if_all[1] < rule['holds_from']:
        verdict = 'in part'
    differences = starts['difference'].median().dropna().to_numpy()
    rng = np.random.default_rng(SEED)
    low, high = bootstrap_interval(differences, np.median, RESAMPLES, 1000, rng)
    return {
        'baseline': baseline,
        'claim': claim,
        'holds': int(counts[0]),
        'settings': len(holds),
        **dict(zip(('low', 'high'), share)),
        **dict(zip(('low_if_none', 'high_if_none'), if_none)),
        **dict(zip(('low_if_all', 'high_if_all'), if_all)),
        'undetermined': int(undetermined.sum()),
        'silent': int(silent.sum()),
        'median': float(np.median(differences)) if len(differences) > 1 else np.nan,
        'median_low': low,
        'median_high': high,
        'verdict': verdict,
    }


def braking(study: Study) -> pd.DataFrame:
    """Return who brakes hard before obstacle 2 in the undisturbed drives of the settings at P3.

    Of both the MPCC brakes earlier or later by the distance of the claim.
    """
    names, rows = ('both', 'earlier', 'later', 'mpcc_alone', 'baseline_alone'), []
    onsets = study.drives[ONSET].xs(0, level='perturbation').unstack('arm')
    lead = study.rules['primaries']['brake_onset']['earlier_m']
    for baseline in (MATCHED, LINEAGE):
        own = onsets.loc[reaching(study, baseline, 'P3')]
        mpcc, other = own[MPCC].notna(), own[baseline].notna()
        earlier = own[baseline] - own[MPCC]
        conditions = mpcc & other, earlier >= lead, earlier <= -lead, mpcc & ~other, ~mpcc & other
        sums = {name: int(values.sum()) for name, values in zip(names, conditions)}
        rows.append({'baseline': baseline, 'settings': len(own), **sums})
    return pd.DataFrame(rows)
