"""Every published share of the first study over settings, from the rows that are kept of it.

The drives of the accepted settings are in accepted_drives.parquet, with the file that fixed the
study beforehand in the metadata. A setting counts for a claim when its undisturbed drives meet the
conditions from P1 to the claim's level. It holds when the claim holds in most of its five starts,
and is undetermined when they disagree, or when one of them does not tell: a car is not at P2, or
does not brake.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from bags.errors import BagError
from experiments.settings import outcomes, plan
from experiments.settings.outcomes import LINEAGE, MATCHED, MPCC
from experiments.settings.plan import LEVELS, Plan
from experiments.settings.primaries import CLAIMS
from experiments.statistical_inference import wilson_interval

FILE = Path('confirmatory', 'accepted_drives.parquet')
ONSET = 'brake_onset_planned_at_m'
RESAMPLES, SEED = 4999, 1


class Study(NamedTuple):
    """The kept rows, and what was fixed before they were driven."""

    rules: Plan
    drives: pd.DataFrame  # a row per drive
    outcomes: pd.DataFrame  # a row per setting, version of the baseline and start


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
        rules = plan.rules(table.schema.metadata[b'preregistration'].decode())
    except (OSError, ArrowException, LookupError, TypeError) as error:
        raise BagError(f'{folder / FILE}: holds no rows of the study: {error}') from None
    judged = pd.DataFrame(outcomes.build(rules, table.to_pylist()))
    return Study(rules, table.to_pandas(), judged)


def reaching(study: Study, baseline: str, level: str) -> pd.DataFrame:
    """Return the outcomes of the settings that meet the conditions from P1 to a level."""
    conditions = list(LEVELS[LEVELS.index('P1') : LEVELS.index(level) + 1])
    rows = study.outcomes[study.outcomes['baseline'] == baseline]
    return rows[rows[conditions].all(axis=1)]


def shares(study: Study) -> Iterator[Share]:
    """Yield every claim at its level, from each version of the baseline."""
    for baseline in (MATCHED, LINEAGE):
        for claim in CLAIMS:
            yield _share(study, baseline, claim)


def _share(study, baseline, claim):
    rows = reaching(study, baseline, getattr(study.rules.primaries, claim).level)
    columns = {name: rows[f'{claim}.{name}'].astype(float) for name in ('holds', 'difference')}
    starts = pd.DataFrame(columns).where(rows['start.P2'].astype(bool)).groupby(rows['setting'])
    known = starts['holds'].agg(['mean', 'count', 'size']).query('count > 0')
    holds = known['mean'] > 0.5
    silent = known['count'] < known['size']
    undetermined = silent | known['mean'].between(0.0, 1.0, inclusive='neither')
    counts = (holds.sum(), (holds & ~undetermined).sum(), (holds | undetermined).sum())
    share, if_none, if_all = (wilson_interval(int(count), len(holds)) for count in counts)
    return Share(
        *(baseline, claim, int(counts[0]), len(holds), *share, *if_none, *if_all),
        *(int(undetermined.sum()), int(silent.sum())),
        *_median(starts['difference'].median().dropna().to_numpy()),
        _verdict(study.rules.decision, if_none, if_all),
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


def _verdict(rule, if_none, if_all):
    """Return what holds however undetermined settings are counted."""
    if if_none[0] > rule.holds_from:
        return 'reproduced'
    if if_all[1] < rule.rare_below:
        return 'not reproduced'
    is_between = if_none[0] > rule.rare_below and if_all[1] < rule.holds_from
    return 'in part' if is_between else 'open'


def braking(study: Study) -> Iterator[Braking]:
    """Yield who brakes, from each version of the baseline."""
    undisturbed = study.drives[study.drives['perturbation'] == 0]
    onsets = undisturbed.pivot(index='setting', columns='arm', values=ONSET).astype(float)
    lead = study.rules.primaries.brake_onset.earlier_m
    for baseline in (MATCHED, LINEAGE):
        own = onsets.loc[reaching(study, baseline, 'P3')['setting'].unique()]
        mpcc, other = own[MPCC].notna(), own[baseline].notna()
        earlier = own[baseline] - own[MPCC]
        conditions = mpcc & other, earlier >= lead, earlier <= -lead, mpcc & ~other, ~mpcc & other
        yield Braking(baseline, len(own), *(int(values.sum()) for values in conditions))
