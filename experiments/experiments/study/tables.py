"""The tables of a study as Markdown, CSV and JSON, each with its provenance."""

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from experiments import code_version
from experiments.configuration import inputs
from experiments.study import run_spec
from experiments.study.variants import SCENARIO, Variant
from node_runtime import parameters, provenance


def build_provenance(command: str, compared: Iterable[Variant], **more: Any) -> dict[str, Any]:
    """Return the provenance of a table: command, code, versions, machine, seed and `more`.

    `compared` are the controllers under the names that the table gives them.
    """
    return {
        'command': command,
        # the name of a file only: its folder on this machine means nothing elsewhere
        'roles': {variant.name: Path(variant.controller).name for variant in compared},
        'commit': provenance.commit(),
        'code_sha256': code_version.digest(),
        'scenario': SCENARIO,
        'scenario_sha256': provenance.digest(inputs.load_scenario(SCENARIO).text),
        'seed': run_spec.SEED,
        'spread': {
            'speed_kph': run_spec.SPEED_SPREAD_KPH,
            'grip': run_spec.GRIP_SPREAD,
            'tolerance': list(run_spec.TOLERANCE_RANGE),
        },
        'versions': provenance.versions() | {'scipy': metadata.version('scipy')},
        'machine': provenance.machine(),
        **more,
    }


def provenance_line(origin: Mapping[str, Any]) -> str:
    """Return a provenance as one line of Markdown."""
    machine = origin['machine']
    roles = ', '.join(f'{role} = {controller}' for role, controller in origin['roles'].items())
    return (
        f'`{origin["command"]}` with {roles}; '
        f'commit {origin["commit"][:12] or "unknown"}, seed {origin["seed"]}, '
        f'{machine["processor"]} with {machine["cores"]} cores.'
    )


def write_tables(
    out: Path,
    stem: str,
    title: str,
    rows: Sequence[Mapping[str, Any]],
    markdown: str,
    origin: Mapping[str, Any],
) -> list[Path]:
    """Write <stem>.md, .csv and .json into the folder `out`; return the paths.

    `rows` have equal keys, flattened in the CSV; `markdown` is the text of the Markdown file,
    `origin` the provenance.
    """
    out.mkdir(parents=True, exist_ok=True)
    paths = [out / f'{stem}.{ending}' for ending in ('md', 'csv', 'json')]
    paths[0].write_text(f'# {title}\n\n{markdown}\n{provenance_line(origin)}\n')
    with open(paths[1], 'w', newline='') as file:
        flat = [_flatten(row) for row in rows]
        writer = csv.DictWriter(file, list(flat[0]))
        writer.writeheader()
        writer.writerows(flat)
    paths[2].write_text(dump_json({'provenance': origin, 'rows': rows}))
    return paths


def dump_json(values: Any) -> str:
    """Return JSON text; raises ValueError for NaN and infinity."""
    return json.dumps(values, indent=2, allow_nan=False) + '\n'


def markdown_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = [header, ['---'] * len(header), *rows]
    return ''.join(f'| {" | ".join(line)} |\n' for line in lines)


def _flatten(row):
    flat = parameters.flatten_mapping(row).items()
    return {n: ' '.join(map(str, v)) if isinstance(v, (list, tuple)) else v for n, v in flat}
