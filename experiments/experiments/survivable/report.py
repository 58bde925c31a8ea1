"""`experiments survivable`: search where every controller lost, and show what was possible."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas
from rich.console import Console
from rich.table import Table

from bags.command_line import print_text
from bags.errors import BagError
from experiments import row_runner
from experiments.drive_records import DriveRecords, record_each
from experiments.drive_row import Offset, Row
from experiments.library.survival_table import share_cell
from experiments.pool import Pool
from experiments.progress import CountProgress
from experiments.survivable import regret
from experiments.survivable.regret import Pairs, Regret
from experiments.survivable.survival_search import (
    IMPOSSIBLE,
    POSSIBLE,
    SEARCH_VERSION,
    UNDECIDED,
)
from msgs_yaml.strict_yaml import closest

FOLDER = 'possible'  # of the verdicts, in the first folder of drives
# of a table of drives, besides those of settings
COLUMNS = (
    *('scenario', 'family', 'difficulty', 'seed', 'draw', 'controller'),
    *('error', 'survived', 'lost_by', 'verdict'),
)
OFFSET = {name: f'offset.{name}' for name in Offset._fields}
CONTROLLER = 'controller.'
SETTINGS = (CONTROLLER, 'plant.', 'scenario.')  # begin the names of their columns
ANSWER = 'answer'
# of the search that gave the answer: an answer of another one is no answer
BUDGET, PREVIEW, VERSION = 'answer_budget', 'answer_preview', 'answer_version'
ANSWERED = (ANSWER, BUDGET, PREVIEW, VERSION)
DERIVED = ('driver', 'offset', 'plant_settings')  # of read_rows
SHOWN_LOSSES = 100


class Request(NamedTuple):
    """The arguments of `experiments survivable`."""

    folders: Sequence[Path]
    budget: int  # rollouts per draw; 0: search nothing
    preview: bool
    base: str  # the controller whose losses are listed and with which the others are paired
    jobs: int
    table: Path | None = None  # receives rows and answers


def run(request: Request, console: Console) -> int:
    """Show regret, losses and paired comparisons; 0 when no search failed. Raises BagError."""
    rows = [row for folder in request.folders for row in read_rows(folder)]
    if request.base not in {row['controller'] for row in rows}:
        known = dict.fromkeys(row['controller'] for row in rows)
        hint = closest(request.base, known)
        raise BagError(f'--base: no drives by {request.base!r}; there are {", ".join(known)}{hint}')
    failures: list[str] = []
    answers, budgets = _kept_answers(rows, request)
    answers |= dict.fromkeys(regret.proved_by_drives(rows), POSSIBLE)
    if request.budget:
        searched = _search(request, rows, answers, failures, console)
        answers |= searched
        budgets |= dict.fromkeys(searched, request.budget)
    console.print(build_table(regret.count_regret(rows, answers)))
    _show_losses(rows, answers, request.base, console)
    others = dict.fromkeys(row['controller'] for row in rows)
    pairs = [regret.pair(rows, request.base, other) for other in others if other != request.base]
    if pairs:
        console.print(build_pairs(pairs))
    if request.table:
        print_text(console, str(write_table(rows, answers, budgets, request)))
    for text in failures:
        print_text(console, text)
    return 1 if failures else 0


def read_rows(place: Path) -> list[dict[str, Any]]:
    """Return the rows of the table of `experiments library` in a folder. Raises BagError.

    Or of a file of `write_table`, whose rows have the answer for their draw besides.

    Rows that were driven with other settings are not confused: those of the controller are added to
    its name, those of plant and scenario are in `plant_settings`, part of the draw.
    """
    from pyarrow import ArrowException, parquet

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
    rows = []
    for row in table.select(kept).to_pylist():
        given = {name: row[name] for name in settings if row[name] is not None}
        own = [f'{name}={value}' for name, value in given.items() if name.startswith(CONTROLLER)]
        rows.append(
            row
            | {
                'driver': row['controller'],
                'controller': ' '.join([row['controller'], *own]),
                'offset': Offset(**{n: row[full] for n, full in OFFSET.items() if full in row}),
                'plant_settings': tuple(
                    (name, tuple(value) if isinstance(value, list) else value)
                    for name, value in given.items()
                    if not name.startswith(CONTROLLER)
                ),
            }
        )
    return rows


def _kept_answers(rows, request):
    """Return the answers in the rows that this search would give, too, and their budgets.

    Undecided is no answer to a search that may go on for longer.
    """
    kept = [
        row
        for row in rows
        if row.get(ANSWER)
        and row.get(VERSION) == SEARCH_VERSION
        and row.get(PREVIEW) == request.preview
        and (row[ANSWER] != UNDECIDED or row[BUDGET] >= request.budget)
    ]
    answers = {regret.draw_key(row): row[ANSWER] for row in kept}
    return answers, {regret.draw_key(row): row[BUDGET] for row in kept}


def write_table(
    rows: Sequence[Mapping[str, Any]],
    answers: Mapping[Row, str],
    budgets: Mapping[Row, int],
    request: Request,
) -> Path:
    """Write rows with the answer for their draw: what every share here is computed from.

    `budgets` has the rollouts that the search for an answer was allowed, none where a drive or
    nothing gave it. Returns the file.
    """
    kept = [
        {name: value for name, value in row.items() if name not in DERIVED}
        | {'controller': row['driver'], ANSWER: answers.get(regret.draw_key(row), UNDECIDED)}
        | {BUDGET: budgets.get(regret.draw_key(row), 0)}
        | {PREVIEW: request.preview, VERSION: SEARCH_VERSION}
        for row in rows
    ]
    drives = pandas.DataFrame(kept).convert_dtypes()
    # what tells drives apart comes first
    results = (*COLUMNS[COLUMNS.index('error') :], *ANSWERED)
    drives = drives[sorted(drives, key=lambda name: name in results)]
    file = request.table
    file.parent.mkdir(parents=True, exist_ok=True)
    drives.to_parquet(file, compression='zstd', index=False)
    return file


def _search(request, rows, answers, failures, console) -> dict[Row, str]:
    """Return the answers of the draws that have none."""
    draws = [draw for draw in dict.fromkeys(map(regret.draw_key, rows)) if draw not in answers]
    if not draws:
        return {}
    new_answers: dict[Row, str] = {}
    errors: dict[str, str] = {}
    first = request.folders[0]
    beside = first.parent if first.is_file() else first
    with (
        CountProgress(console) as progress,
        DriveRecords(beside / FOLDER) as records,
        Pool(request.jobs) as pool,
    ):
        keys = {draw: regret.verdict_key(draw, request.budget, request.preview) for draw in draws}
        missing = {keys[draw]: draw for draw in draws if keys[draw] not in records}
        tasks = [(draw, request.budget, request.preview) for draw in missing.values()]
        ended = pool.finish_each(regret.verdict, tasks)
        record_each(ended, list(missing), len(draws), records, errors, progress)
        for key, error in errors.items():
            failures.append(f'{missing[key].scenario}: no verdict: {error}')
        for draw in draws:
            if keys[draw] in records:
                new_answers[draw] = json.loads(records[keys[draw]])['answer']
    return new_answers


def build_table(families: Sequence[Regret]) -> Table:
    """Return a row per family: what is known of its draws, and survived of the possible ones."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column('survived of the possible', no_wrap=True)
    for name in (POSSIBLE, IMPOSSIBLE, UNDECIDED):
        table.add_column(name, justify='right')
    controllers = list(families[0].survived)
    for controller in controllers:
        table.add_column(controller, justify='right')
        table.add_column('strict', justify='right')
    for family in families:
        counts = [str(family.answers[kind]) for kind in (POSSIBLE, IMPOSSIBLE, UNDECIDED)]
        cells = []
        for controller in controllers:
            survived, strict = family.survived[controller], family.driven_or_undecided[controller]
            cells.append(share_cell(survived, family.driven[controller], digits=0))
            cells.append(f'{survived / strict:.0%}' if strict else '–')
        table.add_row(family.family, *counts, *cells)
    return table


def _show_losses(rows, answers: Mapping[Row, str], base: str, console: Console) -> None:
    losses = list(regret.lost_though_possible(rows, answers, base))
    for row, kind in losses[:SHOWN_LOSSES]:
        why = row['lost_by'] or row['error']
        print_text(console, f'{kind}: {row["scenario"]} {base}: {why} ({row["verdict"]})')
    if len(losses) > SHOWN_LOSSES:
        print_text(console, f'and {len(losses) - SHOWN_LOSSES:,} more')


def build_pairs(pairs: Sequence[Pairs]) -> Table:
    """Return a row per controller that was paired with the base."""
    table = Table(box=None, padding=(0, 2, 0, 0))
    base = pairs[0].base
    for title in (f'{base} and', 'draws', 'both', f'{base} only', 'it only', 'neither'):
        table.add_column(title, justify='right' if title != f'{base} and' else 'left')
    table.add_column('difference (95 %)', justify='right')
    table.add_column('p', justify='right')
    for pair in pairs:
        counts = (pair.draws, pair.both, pair.base_only, pair.other_only, pair.neither)
        if not pair.draws:
            table.add_row(pair.other, *map(str, counts), '–', '–')
            continue
        low, high = pair.interval
        shown = f'{pair.difference:+.1%} ({low:+.1%} to {high:+.1%})'
        table.add_row(pair.other, *map(str, counts), shown, f'{pair.p_value:.2g}')
    return table
