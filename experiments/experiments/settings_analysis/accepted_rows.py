"""The drives of the accepted settings, kept so that every published number can be computed again.

A run of the study has more than 20,000 drives, and its claims rest on those of the settings at P3
for some version of the baseline. `write` keeps these of the cars that are compared, `recompute`
decides them anew and says what differs from the published claims.json. How many settings were
drawn and driven in all, and which of them meet P0, is in claims.json alone (`counts`,
`provenance`); so are causes and drivers, which rest on other drives.
"""

import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from bags.errors import BagError
from experiments.settings import arms, outcomes
from experiments.settings.preconditions import ACCEPTED
from experiments.settings.preregistration import RUNS
from experiments.settings_analysis import decide, study_tables
from experiments.settings_analysis.study_tables import POOLED, Study

FILE = 'accepted_drives.parquet'
CLAIMS = 'claims.json'
KEPT_ARMS = (arms.NO_CA, arms.MPCC, *arms.BASELINES)
TIMES = ('wall_s', 'cpu_s')
# of an entry of claims.json: what the rows do not tell
NOT_IN_ROWS = ('confirmatory', 'causes', 'drivers')
DIGITS = 1e-9  # relative, of a number that is equal


class Recomputed(NamedTuple):
    """One claim of a run, from the rows and as published."""

    run: str
    baseline: str
    claim: str
    holds: int
    settings: int
    share: tuple[float, float] | None  # 95 % interval
    differs: tuple[str, ...]  # names of what is published otherwise


def write(study: Study, folder: Path) -> Path:
    """Write the rows of the accepted settings of a run into a folder; return the path."""
    import pyarrow
    from pyarrow import parquet

    from_level = study.plan.decision.from_level
    own = study.outcomes[study.outcomes['baseline'] != '']
    accepted = study_tables.reaching(own, ACCEPTED, from_level)['setting'].unique()
    is_kept = study.drives['setting'].isin(accepted) & study.drives['arm'].isin(KEPT_ARMS)
    rows = study.drives[is_kept].drop(columns=[*TIMES], errors='ignore')
    table = pyarrow.Table.from_pandas(rows, preserve_index=False)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / FILE
    table = table.replace_schema_metadata(dict(study.notes))
    parquet.write_table(table, path, compression='zstd', compression_level=19)
    return path


def read(file: Path) -> Study:
    """Return the study of the kept rows; its outcomes are computed from them. Raises BagError."""
    drives, notes = study_tables.read_table(file)
    plan = study_tables.plan_of(file, notes)
    judged = pd.DataFrame(outcomes.build(plan, drives.to_dict('records')))
    return Study(plan, drives, judged, int(notes['seed']), notes)


def recompute(folder: Path) -> Iterator[Recomputed]:
    """Yield every claim of the confirmatory run, its repetition, and both as one.

    `folder` holds a folder per run with claims.json and the rows; a run without rows, `without`, is
    left out, and so is the pooled one then. Raises BagError where no run has any, or a file is
    damaged.
    """
    names = [name for name in RUNS[:2] if name not in without(folder)] or RUNS[:1]
    studies = {name: read(folder / name / FILE) for name in names}
    if len(studies) > 1:
        studies[POOLED] = study_tables.pool(list(studies.values()))
    for name, study in studies.items():
        try:
            content = json.loads((folder / name / CLAIMS).read_text(encoding='utf-8'))
        except (OSError, ValueError) as error:
            raise BagError(f'{folder / name / CLAIMS}: {error}') from None
        published = {(claim['baseline'], claim['key']): claim for claim in content['claims']}
        for claim in decide.claim_entries(study, decide.decide(study, explained=())):
            other = published.pop((claim['baseline'], claim['key']), {})
            keys = [key for key in claim if key not in NOT_IN_ROWS]
            yield Recomputed(
                name,
                claim['baseline'],
                claim['key'],
                claim['holds'],
                claim['settings'],
                claim['interval'],
                tuple(key for key in keys if not _equal(claim[key], other.get(key))),
            )
        for baseline, key in published:
            yield Recomputed(name, baseline, key, 0, 0, None, ('no rows',))


def without(folder: Path) -> list[str]:
    """Return the runs of which no rows are kept."""
    return [name for name in RUNS[:2] if not (folder / name / FILE).is_file()]


def _equal(value: Any, other: Any) -> bool:
    """Return whether two contents of claims.json are equal, numbers to the ninth digit."""
    if isinstance(value, Mapping) and isinstance(other, Mapping):
        return value.keys() == other.keys() and all(_equal(value[key], other[key]) for key in value)
    if isinstance(value, (list, tuple)) and isinstance(other, (list, tuple)):
        return len(value) == len(other) and all(map(_equal, value, other))
    if isinstance(value, float) and isinstance(other, (int, float)):
        return math.isclose(value, other, rel_tol=DIGITS, abs_tol=DIGITS)
    return value == other
