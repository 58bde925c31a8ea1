"""The tables of a study over many settings, as data frames with the levels that settings reach."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from bags.errors import BagError
from experiments.settings import arms, preregistration, primaries
from experiments.settings.preregistration import LEVELS, Preregistration
from experiments.settings.run_settings import OUTCOMES, TABLE

FACTORS = arms.FACTORS


class Study(NamedTuple):
    """What a folder of `experiments study settings` holds."""

    plan: Preregistration
    drives: pd.DataFrame  # a row per drive
    outcomes: pd.DataFrame  # a row per setting, version of the baseline, perturbation
    seed: int
    notes: dict[str, str]  # provenance

    def __repr__(self) -> str:
        return f'Study({self.settings} settings, {len(self.drives)} drives, seed {self.seed})'

    @property
    def settings(self) -> int:
        """The number of settings."""
        return int(self.drives['setting'].nunique())

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
    plan = preregistration.load()
    drives, notes = _read(folder / TABLE)
    outcomes, _ = _read(folder / OUTCOMES)
    if notes.get('preregistration') != plan.text:
        raise BagError(f'{folder / TABLE}: was made with another preregistration than {plan.path}')
    return Study(plan, drives, outcomes, int(notes['seed']), notes)


def _read(file):
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


def pairs(outcomes: pd.DataFrame, claim: str) -> pd.DataFrame:
    """Return `setting`, `perturbation`, `holds`, `difference` of the rows that tell of a claim."""
    holds = outcomes[f'{claim}.holds']
    known = outcomes[holds.notna()]
    difference = known.get(f'{claim}.difference')
    return pd.DataFrame(
        {
            'setting': known['setting'].astype(int),
            'perturbation': known['perturbation'].astype(int),
            'holds': holds[holds.notna()].astype(bool),
            'difference': np.nan if difference is None else difference.astype(float),
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


def factorial_drives(study: Study) -> pd.DataFrame:
    """Return the drives of the factorial with a bool column per factor and the responses.

    kept_m             by how much the safety distances are kept; at least -1 m: deeper is a contact
    peak_sideslip_deg  at most 30 deg, beyond which a car has lost control
    brake_onset_m      of a converged plan; without it the station of obstacle 2
    min_speed_mps      least speed
    """
    chosen = study.drives[study.drives['arm'].str.startswith(arms.FACTORIAL)]
    rows = chosen[chosen['error'].fillna('') == '']
    bits = rows['arm'].str.removeprefix(arms.FACTORIAL)
    factors = {name: bits.str[k] == '1' for k, name in enumerate(FACTORS)}
    second = (
        study.plan.course.entry_m
        + rows['change_1_m']
        + rows['plateau_m']
        + rows['obstacle_2_share'] * rows['change_2_m']
    )
    kept = pd.Series([_kept(row) for row in rows.to_dict('records')], rows.index, dtype=float)
    return pd.DataFrame(
        {
            'setting': rows['setting'],
            **factors,
            'kept_m': kept.clip(lower=-1.0),
            'peak_sideslip_deg': rows['peak_sideslip_deg'].clip(upper=30.0),
            'brake_onset_m': rows['brake_onset_planned_at_m'].astype(float).fillna(second),
            'min_speed_mps': rows['min_speed_mps'],
        }
    )


def _kept(row: dict[str, Any]) -> float:
    kept = primaries.kept_distance(row)
    return np.nan if kept is None else kept
