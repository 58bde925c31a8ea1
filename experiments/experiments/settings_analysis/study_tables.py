"""The tables of a study over many settings, as data frames with the levels that settings reach."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from bags.errors import BagError
from experiments.settings import arms, preregistration, primaries
from experiments.settings.outcomes import OF_A_START
from experiments.settings.preconditions import ACCEPTED
from experiments.settings.preregistration import LEVELS, RUNS, Preregistration
from experiments.settings.run_settings import OUTCOMES, TABLE

FACTORS = arms.FACTORS
POOLED = 'pooled'  # instead of the name of a run
NEXT_STUDY = 10_000_000  # what pooling adds to the numbers of settings, per study


class Study(NamedTuple):
    """What a folder of `experiments study settings` holds."""

    plan: Preregistration
    drives: pd.DataFrame  # a row per drive
    outcomes: pd.DataFrame  # a row per setting, version of the baseline, perturbation
    seed: int
    notes: dict[str, str]  # provenance
    parts: tuple['Study', ...] = ()  # the studies that were pooled

    def __repr__(self) -> str:
        return f'Study({self.settings} settings, {len(self.drives)} drives, seed {self.seed})'

    @property
    def settings(self) -> int:
        """The number of settings."""
        return int(self.drives['setting'].nunique())

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of the draws: one, but of a pooled study."""
        return tuple(part.seed for part in self.parts) or (self.seed,)

    @property
    def is_screened(self) -> bool:
        """Whether all controllers drove only where P1 to P3 could be met."""
        if self.parts:
            return any(part.is_screened for part in self.parts)
        return self.notes.get('screened') == 'true'

    @property
    def run(self) -> str:
        """The name of the preregistered run whose seed this is; that of the verdicts otherwise."""
        if self.parts:
            return POOLED
        by_seed = {getattr(self.plan.runs, name).seed: name for name in RUNS}
        return by_seed.get(self.seed, RUNS[0])

    @property
    def failed(self) -> dict[str, int]:
        """The number of drives without a result, by arm that has such."""
        counts = self.drives.loc[self.drives['error'] != '', 'arm'].value_counts()
        return {str(arm): int(count) for arm, count in counts.items()}

    @property
    def otherwise_driven(self) -> list[str]:
        """What of the design is not as the preregistration has it, in words."""
        if self.parts:
            return [f'{part.run}: {text}' for part in self.parts for text in part.otherwise_driven]
        planned = getattr(self.plan.runs, self.run)
        values = {
            'seed': (self.seed, planned.seed),
            'settings': (self.settings, planned.count),
            'screened': (self.is_screened, planned.screened),
        }
        departures = [
            f'{name}: {own}, preregistered {wanted}'
            for name, (own, wanted) in values.items()
            if own != wanted
        ]
        if self.notes.get('interrupted') != 'false':
            departures.append('interrupted: drives are missing')
        return departures

    @property
    def departures(self) -> list[str]:
        """What of the run is not as the preregistration has it, failed drives too, in words."""
        failed = [f'{arm}: {count} drives failed' for arm, count in self.failed.items()]
        return self.otherwise_driven + failed

    @property
    def is_confirmatory(self) -> bool:
        """Whether this is the run whose verdicts count, driven as preregistered."""
        return self.run == RUNS[0] and not self.departures

    @property
    def levels(self) -> tuple[str, ...]:
        """The levels from P2 on of which the tables tell; a screened study is silent below P3."""
        return LEVELS[LEVELS.index('P3' if self.is_screened else 'P2') :]

    @property
    def baselines(self) -> list[str]:
        """The versions of the baseline that were driven."""
        known = set(self.outcomes['baseline'])
        return [name for name in arms.BASELINES if name in known]


def load(folder: Path) -> Study:
    """Read the tables of a folder.

    Raises BagError for a folder without tables, or with those of another preregistration than
    that of this package.
    """
    drives, notes = read_table(folder / TABLE)
    outcomes, _ = read_table(folder / OUTCOMES)
    plan = plan_of(folder / TABLE, notes)
    return Study(plan, drives, outcomes, int(notes['seed']), notes)


def pool(studies: Sequence[Study]) -> Study:
    """Return several studies of different seeds as one.

    Settings are renumbered: `origin` tells seed and number of each. Raises BagError for studies of
    one seed, or of which only some are screened.
    """
    seeds = [study.seed for study in studies]
    if len(set(seeds)) < len(seeds):
        raise BagError(f'pooled studies need different seeds, have {seeds}')
    if len({study.is_screened for study in studies}) > 1:
        raise BagError('screened studies cannot be pooled with others')
    tables = [
        [
            table.assign(setting=table['setting'] + k * NEXT_STUDY)
            for table in (study.drives, study.outcomes)
        ]
        for k, study in enumerate(studies)
    ]
    drives, outcomes = (pd.concat(part, ignore_index=True) for part in zip(*tables))
    first = studies[0]
    return Study(first.plan, drives, outcomes, first.seed, {}, parts=tuple(studies))


def origin(study: Study, setting: int) -> tuple[int, int]:
    """Return the seed and the number of a setting in the draws of that seed."""
    part, number = divmod(setting, NEXT_STUDY)
    return study.seeds[part], number


def plan_of(file: Path, notes: Mapping[str, str]) -> Preregistration:
    """Return the preregistration of this package. Raises BagError where a table has another one."""
    plan = preregistration.load()
    if notes.get('preregistration') != plan.text:
        raise BagError(f'{file}: was made with another preregistration than {plan.path}')
    return plan


def read_table(file: Path) -> tuple[pd.DataFrame, dict[str, str]]:
    """Return a table of a study and its notes. Raises BagError for another file."""
    from pyarrow import ArrowException, parquet

    try:
        table = parquet.read_table(file)
    except (OSError, ArrowException) as error:
        raise BagError(f'{file}: is no table of a study: {error}') from None
    notes = table.schema.metadata or {}
    return table.to_pandas(), {
        key.decode(): value.decode() for key, value in notes.items() if key != b'pandas'
    }


def reaching(outcomes: pd.DataFrame, level: str, least: str = LEVELS[0]) -> pd.DataFrame:
    """Return the rows of the settings that meet all conditions from `least` up to a level."""
    wanted = LEVELS[LEVELS.index(least) : LEVELS.index(level) + 1]
    met = np.logical_and.reduce([outcomes[name].astype(bool) for name in wanted])
    return outcomes[met]


def pairs(outcomes: pd.DataFrame, claim: str, level: str) -> pd.DataFrame:
    """Return `setting`, `perturbation`, `holds`, `difference` of the starts of settings at a level.

    `holds` is 1 or 0, and NaN like the difference where a start does not tell of the claim: it has
    no meaning in it, its drives did not end, or they do not meet P2. (Where a start slips below
    P3 or P4 the claim has a value all the same, and preconditions are those of the undisturbed
    start.) Below P3 only the unperturbed start counts: of those settings some alone were driven
    from the others, by what another version of the baseline does in them.
    """
    if LEVELS.index(level) < LEVELS.index(ACCEPTED):
        outcomes = outcomes[outcomes['perturbation'] == 0]
    meets = outcomes[f'start.{OF_A_START[0]}'].astype(bool)
    columns = {
        name: outcomes.get(f'{claim}.{name}', pd.Series(np.nan, outcomes.index, float))
        for name in ('holds', 'difference')
    }
    return pd.DataFrame(
        {
            'setting': outcomes['setting'].astype(int),
            'perturbation': outcomes['perturbation'].astype(int),
            **{name: values.astype(float).where(meets) for name, values in columns.items()},
        }
    )


def margin(plan: Preregistration, claim: str) -> float | None:
    """Return the equivalence margin of a claim, None for one without a difference."""
    return getattr(getattr(plan.primaries, claim), 'margin', None)


def level(plan: Preregistration, claim: str) -> str:
    """Return the level at which a claim is judged."""
    return getattr(plan.primaries, claim).level


def dimensions(study: Study) -> pd.DataFrame:
    """Return the drawn values by setting."""
    columns = list(study.plan.dimensions)
    return study.drives.drop_duplicates('setting').set_index('setting')[columns]


def braking(study: Study, baseline: str, level: str) -> dict[str, int]:
    """Return how many settings from `from_level` to a level have cars that brake hard, by who does.

    Before obstacle 2, unperturbed. The claim on the onset has a meaning where both do.
    """
    own = study.outcomes[study.outcomes['baseline'] == baseline].drop_duplicates('setting')
    reached = reaching(own, level, study.plan.decision.from_level)['setting']
    rows = study.drives[study.drives['perturbation'] == 0].set_index(['arm', 'setting'])
    brakes = {
        arm: rows.loc[arm].reindex(reached)['brake_onset_planned_at_m'].notna()
        for arm in (arms.MPCC, baseline)
    }
    mpcc, other = brakes[arms.MPCC], brakes[baseline]
    return {
        'both': int((mpcc & other).sum()),
        'MPCC alone': int((mpcc & ~other).sum()),
        'baseline alone': int((~mpcc & other).sum()),
        'none': int((~mpcc & ~other).sum()),
    }


def censored_onsets(study: Study) -> tuple[int, int]:
    """Return how many onsets of braking lie so near the start that they might be earlier, of all.

    They are those of the unperturbed drives of the compared cars.
    """
    rows = study.drives[
        study.drives['arm'].isin((arms.MPCC, *arms.BASELINES)) & (study.drives['perturbation'] == 0)
    ]
    onset = rows['brake_onset_planned_at_m'].astype(float)
    censored = onset < study.plan.primaries.brake_onset.censored_s * rows['speed_mps']
    return int(censored.sum()), int(onset.notna().sum())


def strata(study: Study) -> pd.Series:
    """Return the stratum of S by setting, as an interval; the lower end belongs to it."""
    S = study.drives.drop_duplicates('setting').set_index('setting')['S']
    return pd.cut(
        S, [*study.plan.strata.S[:-1], np.nextafter(study.plan.strata.S[-1], np.inf)], right=False
    )


def factorial_drives(study: Study) -> pd.DataFrame:
    """Return the drives of the factorial with a bool column per factor and the responses.

    kept_m             by how much the safety distances are kept; at least -1 m: deeper is a contact
    peak_sideslip_deg  at most 30 deg, beyond which a car has lost control
    brake_onset_m      of a converged plan; without it the station of obstacle 2
    min_speed_mps      least speed

    NaN in settings that some combination does not complete: what a car did up to its crash is no
    response.
    """
    chosen = study.drives[study.drives['arm'].str.startswith(arms.FACTORIAL)]
    rows = chosen[chosen['error'].fillna('') == '']
    bits = rows['arm'].str.removeprefix(arms.FACTORIAL)
    factors = {name: bits.str[k] == '1' for k, name in enumerate(FACTORS)}
    completed = rows['completed'].fillna(False).astype(bool)
    ended = completed.groupby(rows['setting']).agg(['all', 'size'])
    whole = rows['setting'].map(ended['all'] & (ended['size'] == len(arms.COMBINATIONS)))
    common = pd.DataFrame({'setting': rows['setting'], **factors})
    return common.join(_responses(rows).where(whole.astype(bool)))


def beyond_the_factors(study: Study) -> pd.DataFrame:
    """Return by setting what of each response of `frenet_matched` the factors do not give.

    The response of that baseline less the one of the combination that has all of its factors but
    the smaller priority, which it does not have, and its heading error as drawn.
    """
    rows = study.drives[(study.drives['perturbation'] == 0) & study.drives['completed'].eq(True)]
    is_nearest = rows['arm'] == arms.FACTORIAL + '1110' + rows['heading'].astype(int).astype(str)
    nearest = rows[is_nearest].set_index('setting')
    matched = rows[rows['arm'] == arms.MATCHED].set_index('setting')
    both = nearest.index.intersection(matched.index)
    return _responses(matched.loc[both]) - _responses(nearest.loc[both])


def _responses(rows):
    kept = pd.Series([_kept(row) for row in rows.to_dict('records')], rows.index, dtype=float)
    return pd.DataFrame(
        {
            'kept_m': kept.clip(lower=-1.0),
            'peak_sideslip_deg': rows['peak_sideslip_deg'].clip(upper=30.0),
            'brake_onset_m': rows['brake_onset_planned_at_m']
            .astype(float)
            .fillna(rows['obstacle_2_at_m']),
            'min_speed_mps': rows['min_speed_mps'],
        }
    )


def _kept(row: dict[str, Any]) -> float:
    kept = primaries.kept_distance(row)
    return np.nan if kept is None else kept
