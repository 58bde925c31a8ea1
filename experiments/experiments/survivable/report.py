"""`experiments survivable`: what was lost though it was possible, from tables of drives.

A draw that any controller survived is possible: its drive proves it. For the others `verdict`
searches.
"""

import argparse
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas
from rich.console import Console
from rich.table import Table

from bags import command_line
from bags.command_line import print_text
from bags.errors import BagError
from experiments import drive_row, row_runner
from experiments.drive_row import Offset, Row
from experiments.families.draw import NOMINAL
from experiments.library import ALL, family_of, share_cell
from experiments.pool import Pool
from experiments.row_runner import DriveRecords
from experiments.statistical_inference import paired_interval
from experiments.survivable.survival_search import (
    IMPOSSIBLE,
    POSSIBLE,
    SEARCH_VERSION,
    UNDECIDED,
    survivable,
)
from msgs_yaml.strict_yaml import closest

FOLDER = 'possible'  # of the verdicts, in the first folder of drives
SHOWN_LOSSES = 100
# the first drives until the instant of action; all of them are drivers with hindsight
DRIVERS = ('mpcc', 'mpcc_road')
# columns of a table of drives, besides those of settings
RESULTS = ('error', 'survived', 'lost_by', 'verdict')
COLUMNS = ('scenario', 'family', 'difficulty', 'seed', 'draw', 'controller', *RESULTS)
OFFSET = {name: f'offset.{name}' for name in Offset._fields}
# begin the names of columns of settings: what tells controllers apart, and all
CONTROLLERS = 'controller.', 'estimator.'
SETTINGS = (*CONTROLLERS, 'plant.', 'scenario.')
# of a verdict, and of the search that gave it: an answer of another one is no answer
ANSWERED = ('answer', *(f'answer_{what}' for what in ('budget', 'preview', 'version')))
ANSWER, BUDGET, PREVIEW, VERSION = ANSWERED


def run(options: argparse.Namespace, console: Console) -> int:
    """Show regret, losses and paired comparisons; 0 when no search failed. Raises BagError.

    `options` are those of `experiments survivable`.
    """
    base, budget, preview = options.base, options.budget, options.preview
    drives = read_drives(options.folders)
    names = list(dict.fromkeys(drives['name']))
    if base not in names:
        hint = closest(base, names)
        raise BagError(f'--base: no drives by {base!r}; there are {", ".join(names)}{hint}')
    answers = _kept_answers(drives, budget, preview)
    # a drive that survived is a proof
    answers |= dict.fromkeys(drives['what'][drives['survived'].eq(True)], (POSSIBLE, 0))
    failures: list[str] = []
    if budget:
        first = options.folders[0]
        first = first.parent if first.is_file() else first
        draws = [draw for draw in dict.fromkeys(drives['what']) if draw not in answers]
        searched = _search(draws, options, first / FOLDER, failures, console)
        answers |= {draw: (answer, budget) for draw, answer in searched.items()}
    known = [answers.get(draw, (UNDECIDED, 0)) for draw in drives['what']]
    drives[ANSWER], drives[BUDGET] = zip(*known)
    drives[PREVIEW], drives[VERSION] = preview, SEARCH_VERSION
    console.print(build_table(drives))
    lost = drives[(drives['name'] == base) & ~drives['survived'].eq(True)]
    losses = pandas.concat([lost[lost[ANSWER] == kind] for kind in (POSSIBLE, UNDECIDED)])
    for loss in losses[:SHOWN_LOSSES].to_dict('records'):
        why = loss['lost_by'] or loss['error']
        print_text(console, f'{loss[ANSWER]}: {loss["scenario"]} {base}: {why} ({loss["verdict"]})')
    if len(losses) > SHOWN_LOSSES:
        print_text(console, f'and {len(losses) - SHOWN_LOSSES:,} more')
    if len(names) > 1:
        # of each other controller, on the draws that both have driven
        counts = 'draws', 'both', f'{base} only', 'it only', 'neither'
        pairs = ((other, split_pairs(drives, base, other)) for other in names if other != base)
        rows = [[other, *pair_cells(*split)] for other, split in pairs]
        columns = [f'{base} and', *counts, 'difference (95 %)', 'p']
        console.print(command_line.table(columns, rows))
    if options.table:
        write_table(drives, options.table)
        print_text(console, str(options.table))
    for text in failures:
        print_text(console, text)
    return 1 if failures else 0


def _kept_answers(drives, budget, preview) -> dict[Row, tuple[str, int]]:
    """Return the answers in a table that this search would give, too, with their budgets.

    Undecided is no answer to a search that may go on for longer.
    """
    if ANSWER not in drives:
        return {}
    kept = drives[
        drives[ANSWER].notna()
        & drives[VERSION].eq(SEARCH_VERSION)
        & drives[PREVIEW].eq(preview)
        & (drives[ANSWER].ne(UNDECIDED) | drives[BUDGET].fillna(0).ge(budget))
    ]
    return dict(zip(kept['what'], zip(kept[ANSWER], kept[BUDGET])))


def _search(draws, options, folder, failures, console) -> Mapping[Row, str]:
    """Return the answers of draws; one without goes to `failures`."""
    if not draws:
        return {}
    how = options.budget, options.preview
    errors: dict[str, str] = {}
    with DriveRecords(folder) as records, Pool(options.jobs, console=console) as pool:
        keys = {draw: _key(draw, *how) for draw in draws}
        tasks = {key: (draw, *how) for draw, key in keys.items()}
        records.finish(pool, verdict, tasks, errors)
        for key, error in errors.items():
            failures.append(f'{tasks[key][0].scenario}: no verdict: {error}')
        return {
            draw: json.loads(records[key])['answer'] for draw, key in keys.items() if key in records
        }


def build_table(drives: pandas.DataFrame) -> Table:
    """Return a row per family: what is known of its draws, and survived of the possible ones."""
    kinds, names = (POSSIBLE, IMPOSSIBLE, UNDECIDED), list(dict.fromkeys(drives['name']))
    scores = [title for name in names for title in (name, 'strict')]
    judged = drives[drives['error'] == '']
    families, rows = dict.fromkeys(drives['group']), []
    groups = [(family, judged[judged['group'] == family]) for family in families]
    for family, own in [*groups, (ALL, judged)] if len(groups) > 1 else groups:
        answers = list(dict(zip(own['what'], own[ANSWER])).values())
        cells = [str(answers.count(kind)) for kind in kinds]
        for name in names:
            by_name = own[own['name'] == name]
            survived = int(by_name['survived'].eq(True).sum())
            strict = int(by_name[ANSWER].ne(IMPOSSIBLE).sum())
            cells.append(share_cell(survived, int(by_name[ANSWER].eq(POSSIBLE).sum()), digits=0))
            cells.append(f'{survived / strict:.0%}' if strict else '–')
        rows.append([family, *cells])
    return command_line.table(['survived of the possible', *kinds, *scores], rows)


def split_pairs(drives: pandas.DataFrame, base: str, other: str) -> tuple[int, int, int, int]:
    """Return the draws that both survived, the base alone, the other alone, and neither."""
    judged = drives[drives['error'] == '']
    ours, theirs = (
        dict(zip(own['what'], own['survived'].eq(True)))
        for own in (judged[judged['name'] == name] for name in (base, other))
    )
    split = [(ours[draw], theirs[draw]) for draw in ours.keys() & theirs.keys()]
    kinds = (True, True), (True, False), (False, True), (False, False)
    return tuple(split.count(kind) for kind in kinds)


def pair_cells(both: int, base_only: int, other_only: int, neither: int) -> list[str]:
    """Return the counts of a pair, their difference with Tango's interval, and the p-value.

    That is McNemar's exact test: how likely so uneven a split is when neither is better.
    """
    # imported late: scipy.stats takes half a second to load
    from scipy.stats import binomtest

    counts = [both, base_only, other_only, neither]
    cells = [f'{count}' for count in (sum(counts), *counts)]
    if not sum(counts):
        return [*cells, '–', '–']
    differ = base_only + other_only
    low, high = paired_interval(base_only, other_only, sum(counts))
    p_value = float(binomtest(base_only, differ).pvalue) if differ else 1.0
    difference = (base_only - other_only) / sum(counts)
    return [*cells, f'{difference:+.1%} ({low:+.1%} to {high:+.1%})', f'{p_value:.2g}']


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
    own = [f'{name}={value}' for name, value in given.items() if name.startswith(CONTROLLERS)]
    plant = tuple(
        (name, tuple(value) if isinstance(value, list) else value)
        for name, value in given.items()
        if not name.startswith(CONTROLLERS)
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


def _key(draw, budget, preview):
    """Return the SHA-256 of what decides a verdict; not the code: what survived stays a proof."""
    setup = drive_row.prepare(draw._replace(controller=DRIVERS[0]), any_car=True)
    car = setup.plant, setup.friction, setup.faults, setup.sensors, setup.sensors_seed
    content = [SEARCH_VERSION, setup.scn.text, repr(car), budget, preview, draw.offset]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def verdict(draw: Row, budget: int, preview: bool) -> str:
    """Return {'answer': ..., 'how': ..., 'rollouts': ...} of a draw as JSON."""
    setups = [drive_row.prepare(draw._replace(controller=c), any_car=True) for c in DRIVERS]
    drivers = [setup.params for setup in setups]
    result = survivable(setups[0], budget, preview=preview, drivers=drivers)
    return json.dumps({name: getattr(result, name) for name in ('answer', 'how', 'rollouts')})
