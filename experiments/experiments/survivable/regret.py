"""What was lost though it was possible: tables of drives, and the verdict on a draw.

A draw that any controller survived is possible: its drive proves it. For the others `verdict`
searches.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas

from bags.errors import BagError
from experiments import drive_row, row_runner
from experiments.drive_row import Offset, Row
from experiments.families.draw import NOMINAL
from experiments.library.survival_table import family_of
from experiments.survivable.survival_search import SEARCH_VERSION, survivable

# the first drives until the instant of action; all of them are drivers with hindsight
DRIVERS = ('mpcc', 'mpcc_road')
# columns of a table of drives, besides those of settings
RESULTS = ('error', 'survived', 'lost_by', 'verdict')
COLUMNS = ('scenario', 'family', 'difficulty', 'seed', 'draw', 'controller', *RESULTS)
OFFSET = {name: f'offset.{name}' for name in Offset._fields}
CONTROLLER = 'controller.'
SETTINGS = (CONTROLLER, 'plant.', 'scenario.')  # begin the names of their columns
# of a verdict, and of the search that gave it: an answer of another one is no answer
ANSWERED = ('answer', *(f'answer_{what}' for what in ('budget', 'preview', 'version')))
ANSWER, BUDGET, PREVIEW, VERSION = ANSWERED


def read_drives(places: Sequence[Path]) -> pandas.DataFrame:
    """Return the drives of tables of `experiments library`, of folders or files of `write_table`.

    The columns are those of the tables that are needed, and `name`, the controller with its
    settings; `what`, the Row of its draw without a controller, with the settings of plant and
    scenario; `group`, the family. Raises BagError.
    """
    from pyarrow import ArrowException, parquet

    drives = []
    for place in places:
        path = place if place.is_file() else place / row_runner.TABLE
        try:
            table = parquet.read_table(path)
        except (OSError, ArrowException) as error:
            raise BagError(f'{path}: is no table of experiments library: {error}') from None
        names = table.column_names
        missing = [name for name in COLUMNS if name not in names]
        if missing:
            raise BagError(f'{path}: has no column {missing[0]}; is it of experiments library?')
        settings = [n for n in names[: names.index('error')] if n.startswith(SETTINGS)]
        kept = [*COLUMNS, *settings, *(n for n in (*OFFSET.values(), *ANSWERED) if n in names)]
        drives += [_read(row, settings) for row in table.select(kept).to_pylist()]
    # what a drive has not is None, whatever the other drives have
    read = pandas.DataFrame(drives, dtype=object)
    return read.where(read.notna(), None)


def _read(row: Mapping[str, Any], settings):
    given = {name: row[name] for name in settings if row[name] is not None}
    own = [f'{name}={value}' for name, value in given.items() if name.startswith(CONTROLLER)]
    plant = tuple(
        (name, tuple(value) if isinstance(value, list) else value)
        for name, value in given.items()
        if not name.startswith(CONTROLLER)
    )
    offset = Offset(**{name: row[full] for name, full in OFFSET.items() if full in row})
    drawn = row['seed'] or 0, row['difficulty'] or NOMINAL
    return row | {
        'name': ' '.join([row['controller'], *own]),
        'group': family_of(row),
        'what': Row(row['scenario'], '', plant, *drawn, offset),
    }


def write_table(drives: pandas.DataFrame, file: Path) -> None:
    """Write drives with the answer for their draw: what every share here is computed from."""
    inputs = [n for n in drives if n not in (*RESULTS, *ANSWERED, 'name', 'group', 'what')]
    file.parent.mkdir(parents=True, exist_ok=True)
    table = drives[[*inputs, *RESULTS, *ANSWERED]].convert_dtypes()
    table.to_parquet(file, compression='zstd', index=False)


def verdict_key(draw: Row, budget: int, preview: bool) -> str:
    """Return the SHA-256 of what decides a verdict: scenario, plant, budget, version of the search.

    The code of the controllers is no part of it: a drive that survived stays a proof.
    """
    setup = drive_row.prepare(draw._replace(controller=DRIVERS[0]), any_car=True)
    content = [SEARCH_VERSION, setup.scn.text, repr(setup.plant), setup.friction, budget, preview]
    return hashlib.sha256(json.dumps([*content, draw.offset]).encode()).hexdigest()


def verdict(draw: Row, budget: int, preview: bool) -> str:
    """Return {'answer': ..., 'how': ..., 'rollouts': ...} of a draw as JSON."""
    setups = [drive_row.prepare(draw._replace(controller=c), any_car=True) for c in DRIVERS]
    drivers = [setup.params for setup in setups]
    result = survivable(setups[0], budget, preview=preview, drivers=drivers)
    return json.dumps({name: getattr(result, name) for name in ('answer', 'how', 'rollouts')})
