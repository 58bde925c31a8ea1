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

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import yaml

from bags.errors import BagError
from experiments.statistical_inference import wilson_interval

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


class Share(NamedTuple):
    """A claim from one version of the baseline; intervals are of 95 %."""

    baseline: str
    claim: str
    holds: int  # settings
    settings: int
    low: float  # of the share of settings, Wilson's
    high: float
    low_if_none: float  # the same where what is undetermined does not hold
    high_if_none: float
    low_if_all: float  # the same where it does
    high_if_all: float
    undetermined: int  # settings
    silent: int  # of these with a start that does not tell
    median: float  # difference in the paper's direction, NaN of a claim without one
    median_low: float  # percentile bootstrap
    median_high: float
    verdict: str


class Braking(NamedTuple):
    """Who brakes hard before obstacle 2 in the undisturbed drives of the settings at P3."""

    baseline: str
    settings: int
    both: int
    earlier: int  # the MPCC, by the distance of the claim
    later: int
    mpcc_alone: int
    baseline_alone: int


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


def shares(study: Study) -> Iterator[Share]:
    """Yield every claim at its level, from each version of the baseline."""
    for baseline in (MATCHED, LINEAGE):
        mpcc, other = (study.drives.loc[arm] for arm in (MPCC, baseline))
        mpcc = mpcc.loc[other.index]
        differences, holds = _judge(study.rules['primaries'], mpcc, other)
        tells = _avoids(mpcc) & _avoids(other)
        for claim in CLAIMS:
            counted = reaching(study, baseline, study.rules['primaries'][claim]['level'])
            starts = pd.DataFrame({'difference': differences[claim], 'holds': holds[claim]})
            starts = starts.where(tells).loc[counted].groupby('setting')
            yield _share(baseline, claim, starts, study.rules['decision'])


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
    return Share(
        *(baseline, claim, int(counts[0]), len(holds), *share, *if_none, *if_all),
        *(int(undetermined.sum()), int(silent.sum())),
        *_median(starts['difference'].median().dropna().to_numpy()),
        verdict,
    )


def _median(differences):
    """Return the median and its interval, NaN of fewer than two settings."""
    from scipy.stats import bootstrap

    if len(differences) < 2:
        return (np.nan,) * 3
    resampled = bootstrap(
        (differences,),
        np.median,
        n_resamples=RESAMPLES,
        method='percentile',
        batch=1000,
        rng=np.random.default_rng(SEED),
    )
    return float(np.median(differences)), *map(float, resampled.confidence_interval)


def braking(study: Study) -> Iterator[Braking]:
    """Yield who brakes, from each version of the baseline."""
    onsets = study.drives[ONSET].xs(0, level='perturbation').unstack('arm')
    lead = study.rules['primaries']['brake_onset']['earlier_m']
    for baseline in (MATCHED, LINEAGE):
        own = onsets.loc[reaching(study, baseline, 'P3')]
        mpcc, other = own[MPCC].notna(), own[baseline].notna()
        earlier = own[baseline] - own[MPCC]
        conditions = mpcc & other, earlier >= lead, earlier <= -lead, mpcc & ~other, ~mpcc & other
        yield Braking(baseline, len(own), *(int(values.sum()) for values in conditions))
