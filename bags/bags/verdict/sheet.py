"""The metrics of a comparison as CSV: a row per number, a column per run, every digit."""

import csv
import io
from collections.abc import Iterator, Mapping
from typing import Any

FILE = 'comparison.csv'


def text(runs: Mapping[str, Mapping[str, Any]]) -> str:
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
        writer.writerow([row, *(_cell(column.get(row)) for column in columns.values())])
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


def _cell(value):
    if value is None:
        return ''
    return str(value).lower() if isinstance(value, bool) else repr(value)
