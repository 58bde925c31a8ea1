"""The comparison as a table for a person: a row per metric, a column per controller.

The metrics of a comparison as CSV: a row per number, a column per run, every digit."""

import csv
import io
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from rich import box
from rich.table import Table
from rich.text import Text

from bags.figures.style import TUNED

PAPER_SOLVE_MS = {'mean': 15.6, 'max': 18.6}  # FORCESPro on a dSPACE DS6001, 2.8 GHz
COLOURS = {True: 'green', False: 'red', None: ''}
PAPER_NOTE = 'paper: its MPCC with FORCESPro on a dSPACE DS6001'


class Row(NamedTuple):
    """One metric: its title, unit, decimals, and where it lies in the dictionary."""

    title: str
    unit: str
    decimals: int
    path: tuple[str, ...]


ROWS = (
    Row('completed', '', 0, ('completed',)),
    Row('collided', '', 0, ('collided',)),
    Row('left the road', '', 0, ('left_road',)),
    Row('  at station', 'm', 1, ('left_road_at_m',)),
    Row('  outline beyond the edge', 'm', 2, ('beyond_edge_m',)),
    Row('lost control', '', 0, ('lost',)),
    Row('  at station', 'm', 1, ('lost_at_m',)),
    Row('entered unsafe area', '', 0, ('entered_unsafe_area',)),
    Row('min distance to obstacle', 'm', 2, ('min_v2o_m',)),
    Row('min distance to road edge', 'm', 2, ('min_v2e_m',)),
    Row('  left', 'm', 2, ('min_v2e_per_edge_m', 'left')),
    Row('  right', 'm', 2, ('min_v2e_per_edge_m', 'right')),
    Row('min gap of the outline', 'm', 2, ('min_outline_gap_m',)),
    Row('overshoots at x', 'm', 2, ('overshoots',)),
    Row('peak sideslip angle', 'deg', 1, ('peak_sideslip_deg',)),
    Row('  at station', 'm', 1, ('peak_sideslip_at_m',)),
    Row('min speed', 'm/s', 1, ('min_speed_mps',)),
    Row('braking from station', 'm', 1, ('brake_onset_at_m',)),
    Row('peak deceleration', 'm/s²', 1, ('peak_brake_mps2',)),
    Row('peak lateral acceleration', 'm/s²', 1, ('peak_lat_acc_mps2',)),
    Row('rms contouring error', 'm', 2, ('rms_contouring_m',)),
    Row('solve time, mean', 'ms', 1, ('solve_ms', 'mean')),
    Row('solve time, median', 'ms', 1, ('solve_ms', 'p50')),
    Row('solve time, 99 %', 'ms', 1, ('solve_ms', 'p99')),
    Row('solve time, max', 'ms', 1, ('solve_ms', 'max')),
    Row('ticks', '', 0, ('ticks',)),
    Row('deadline misses', '', 0, ('deadline_misses',)),
    Row('fallbacks', '', 0, ('fallbacks',)),
)
GOOD_WHEN = {
    'completed': True,
    'collided': False,
    'left_road': False,
    'lost': False,
    'entered_unsafe_area': False,
}
# rows that only matter where they have a number
DETAILS = ('left_road_at_m', 'beyond_edge_m', 'lost_at_m')
# what a yes means: circles may touch where the outline does not
HOW = {'collided': ('yes, {}', 'collided_by'), 'lost': ('{}', 'lost_how')}


class Cell(NamedTuple):
    """One value as text; `good` judges it where it can be judged."""

    text: str
    good: bool | None = None


class Line(NamedTuple):
    """One row of the table: a cell per run, and the paper's number or ''."""

    title: str
    unit: str
    cells: list[Cell]
    paper: str


def table_lines(runs: Mapping[str, Mapping[str, Any]]) -> list[Line]:
    """Return the rows of a comparison of `runs`, as in comparison.json."""
    return [
        Line(
            row.title,
            row.unit,
            [_cell(row, found) for found in runs.values()],
            _paper(row),
        )
        for row in _rows(runs)
    ]


def is_sound(found: Mapping[str, Any]) -> bool:
    """Tell whether a run stayed on the road and under control: else nothing of it is green."""
    return not (found.get('lost') or found.get('left_road'))


def build_table(comparison: dict) -> Table:
    """Return the table of a comparison (the dictionary of comparison.json)."""
    runs = comparison['runs']
    table = Table(
        title=f'Scenario {comparison["scenario"]}',
        title_justify='left',
        caption=PAPER_NOTE,
        caption_justify='left',
        # no lines between the columns: three controllers fit into 80 characters
        box=box.SIMPLE_HEAD,
        show_edge=False,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    table.add_column('metric', no_wrap=True)
    table.add_column('unit', no_wrap=True)
    for name in runs:
        cut = name in comparison.get('damage', {})
        # on two lines, so that three of them fit into 80 characters, too
        shown = f'{name.removesuffix(TUNED)}\n{TUNED[1:]}' if name.endswith(TUNED) else name
        table.add_column(f'{shown}, bag cut' if cut else shown, justify='right', no_wrap=True)
    table.add_column('paper', justify='right', style='dim', no_wrap=True)
    for line in table_lines(runs):
        cells = [Text(cell.text, COLOURS[cell.good]) for cell in line.cells]
        table.add_row(line.title, line.unit, *cells, line.paper)
    return table


def _rows(runs):
    """Return the rows, with one for each obstacle below the nearest of them."""
    numbers = dict.fromkeys(i for found in runs.values() for i in found['min_v2o_per_obstacle_m'])
    for row in ROWS:
        if row.path[0] in DETAILS and all(_look_up(f, row.path) is None for f in runs.values()):
            continue
        yield row
        if row.path == ('min_v2o_m',):
            for i in numbers:
                yield Row(f'  obstacle {i}', 'm', 2, ('min_v2o_per_obstacle_m', i))


def _look_up(found: Mapping, path: tuple[str, ...]) -> Any:
    for key in path:
        found = found.get(key)
    return found


def _cell(row, found):
    value = _look_up(found, row.path)
    if value is None:
        return Cell('–')
    if isinstance(value, bool):
        return _yes_or_no(row.path[0], value, found)
    if isinstance(value, list):
        found = (f'{one["amount_m"]:.2f} at {one["x_m"]:.0f}' for one in value)
        return Cell('\n'.join(found) or 'none')
    return Cell(f'{value:.{row.decimals}f}')


def _yes_or_no(name, value, found):
    """Return yes or no, with how; bad is red, good is green only in a run that is sound."""
    form, key = HOW.get(name, ('yes', ''))
    text = form.format(found.get(key)) if value else 'no'
    good = value == GOOD_WHEN[name]
    return Cell(text, None if good and not is_sound(found) else good)


def _paper(row):
    if row.path[0] != 'solve_ms':
        return ''
    return f'{PAPER_SOLVE_MS[row.path[1]]:.1f}' if row.path[1] in PAPER_SOLVE_MS else ''


CSV_FILE = 'comparison.csv'


def metrics_csv(runs: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the CSV of `runs`, the dictionary of comparison.json by run name.

    Rows are named by their place in that dictionary, as in `min_v2o_per_obstacle_m.1` or
    `overshoots.0.x_m`; what a run does not have is an empty cell.
    """
    columns = {name: dict(_flat(found)) for name, found in runs.items()}
    rows = dict.fromkeys(row for column in columns.values() for row in column)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator='\n')
    writer.writerow(['metric', *columns])
    for row in rows:
        writer.writerow([row, *(_csv_cell(column.get(row)) for column in columns.values())])
    return out.getvalue()


def _flat(value, path=()) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        children = value.items()
    elif isinstance(value, list):
        children = enumerate(value)
    else:
        yield '.'.join(path), value
        return
    for key, child in children:
        yield from _flat(child, (*path, str(key)))


def _csv_cell(value):
    if value is None:
        return ''
    return str(value).lower() if isinstance(value, bool) else repr(value)
