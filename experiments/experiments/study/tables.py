"""One table as Markdown, CSV and JSON, with where it comes from."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.study import provenance


def write(
    out: Path,
    stem: str,
    title: str,
    rows: Sequence[Mapping[str, Any]],
    markdown: str,
    found: Mapping[str, Any],
) -> list[Path]:
    """Write <stem>.md, .csv and .json into the folder `out`; return the paths.

    `rows` have equal keys; the CSV has them flat, the JSON as they are; `markdown` is what a
    person reads, `found` the provenance.
    """
    out.mkdir(parents=True, exist_ok=True)
    paths = [out / f'{stem}.{ending}' for ending in ('md', 'csv', 'json')]
    paths[0].write_text(f'# {title}\n\n{markdown}\n{provenance.line(dict(found))}\n')
    with open(paths[1], 'w', newline='') as file:
        flat = [_flat(row) for row in rows]
        writer = csv.DictWriter(file, list(flat[0]))
        writer.writeheader()
        writer.writerows(flat)
    paths[2].write_text(dumped({'provenance': found, 'rows': rows}))
    return paths


def dumped(values: Any) -> str:
    """Return JSON text, numbers that are none refused."""
    return json.dumps(values, indent=2, allow_nan=False) + '\n'


def markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [header, ['---'] * len(header), *rows]
    return ''.join(f'| {" | ".join(line)} |\n' for line in lines)


def _flat(row, prefix=''):
    found = {}
    for key, value in row.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f'{prefix}{key}.')
        elif isinstance(value, (list, tuple)):
            found[prefix + key] = ' '.join(map(str, value))
        else:
            found[prefix + key] = value
    return found
