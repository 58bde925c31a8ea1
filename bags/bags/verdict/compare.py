"""Compare runs offline, from their bags only: metrics, one JSON file, a table, figures."""

import json
import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from bags.errors import BagError, DamagedBagWarning
from bags.pictures import figures, palette, panels, table
from bags.storage import read
from bags.verdict import judge, metrics, recorded
from bags.verdict.drive import Drive

FILE = 'comparison.json'
FIGURES = 'figures'


class Comparison(NamedTuple):
    """What came out, and where it was written."""

    values: dict[str, Any]  # comparison.json
    file: Path
    figures: list[Path]


def bags(paths: Sequence[Path | str], out: Path, force: bool = False) -> Comparison:
    """Compare the bags at `paths` and write comparison.json and figures/ into the folder `out`.

    Raises BagError for bags that cannot be judged, that name the same controller twice, or that
    drove unlike scenarios (`force` compares them all the same, on the road of the first).
    """
    with warnings.catch_warnings():
        # the damage is part of what comes out
        warnings.simplefilter('ignore', DamagedBagWarning)
        loaded = [read.load(path) for path in paths]
    if not force:
        _same_scenario(paths, [bag.run_info for bag in loaded])
    drives = {}
    for path, bag in zip(paths, loaded):
        found = recorded.of_bag(bag)
        name = found.facts.controller
        if name in drives:
            raise BagError(f'{path}: another bag also holds a run of {name}; compare one of them')
        drives[name] = found
    damage = {name: bag.damage for name, bag in zip(drives, loaded) if bag.damage}
    return write(drives, out, damage)


def _same_scenario(paths, infos):
    first, *others = (info.get('scenario_sha256') for info in infos)
    for path, info, digest in zip(paths[1:], infos[1:], others):
        if digest != first:
            ours, theirs = infos[0].get('scenario', '?'), info.get('scenario', '?')
            differ = f'{ours!r} and {theirs!r}' if ours != theirs else f'two versions of {ours!r}'
            raise BagError(
                f'{paths[0]} and {path} drove unlike scenarios ({differ}): their numbers do not '
                'compare; --force compares them all the same'
            )


def write(
    drives: dict[str, Drive], out: Path, damage: Mapping[str, str] | None = None
) -> Comparison:
    """Judge drives by controller name and write what came out into the folder `out`.

    `damage` says of a drive that its bag was only read up to some place.
    """
    scenario = next(iter(drives.values())).facts.scenario
    colours = palette.colours(list(drives))
    runs = [panels.Run(n, one, judge.series(one), colours[n]) for n, one in drives.items()]
    found = {run.name: metrics.of_series(run.drive, run.series) for run in runs}
    values = {'scenario': scenario, 'runs': found}
    if damage:
        values['damage'] = dict(damage)
    out.mkdir(parents=True, exist_ok=True)
    file = out / FILE
    file.write_text(json.dumps(values, indent=2, allow_nan=False) + '\n')
    return Comparison(values, file, figures.write(runs, scenario, out / FIGURES))


def show(comparison: Comparison, console: Console) -> None:
    """Print the table, and where the files are."""
    for damage in comparison.values.get('damage', {}).values():
        console.print(damage, style='red', markup=False, highlight=False, soft_wrap=True)
    console.print(table.build(comparison.values))
    sheet = next(path for path in comparison.figures if path.suffix == '.png')
    for label, path in (('numbers', comparison.file), ('figures', sheet)):
        console.print(f'{label}: {os.path.relpath(path)}', markup=False, highlight=False)
