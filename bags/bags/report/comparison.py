"""Compare runs from their bags: comparison.json, CSV, a table, figures and report.html."""

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from bags import metrics_table
from bags.command_line import print_paths, print_text
from bags.errors import BagError
from bags.evaluation import metrics
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.figures import comparison_figures, style
from bags.figures.overlay import Overlay, read_overlays
from bags.report import page
from bags.report.comparability import check_comparable
from bags.run import Run, load_quietly
from bags.storage.invalid_messages import KEY, describe_invalid

FILE = 'comparison.json'
FIGURES = 'figures'


class Comparison(NamedTuple):
    """The metrics, and the files that were written."""

    values: dict[str, Any]  # comparison.json
    file: Path
    sheet: Path
    figures: list[Path]
    report: Path
    replaced: tuple[str, ...] = ()  # the runs of the comparison that was in its place


def compare_bags(
    paths: Sequence[Path | str],
    out: Path,
    force: bool = False,
    overlay_files: Sequence[Path] = (),
    singly: bool = False,
) -> Comparison:
    """Compare the bags at `paths` and write the results into the folder `out`.

    They are comparison.json, comparison.csv, figures/ and report.html. The curves of the CSV
    files `overlay_files` (`figures.overlay`) are drawn beside those of the runs; `singly`: each
    panel is a figure, too. Runs of one controller are called after their folders. Raises BagError
    for bags that cannot be evaluated, for one that is given twice, and for runs of different
    scenarios or plants (`force` compares them anyway, on the road of the first).
    """
    runs = load_runs(paths)
    if not force:
        check_comparable(paths, [run.run_info for run in runs.values()])
    drawn = style.assign(runs)
    overlays = read_overlays(overlay_files, list(runs), drawn[0].drive.scene)
    return compare_runs(drawn, out, overlays, singly)


def load_runs(paths: Sequence[Path | str]) -> dict[str, Run]:
    """Return the runs of bags by their names (`name_runs`). Raises BagError."""
    runs = [load_quietly(path) for path in paths]
    return dict(zip(name_runs(paths, [run.drive.facts.controller for run in runs]), runs))


def name_runs(paths: Sequence[Path | str], recorded: Sequence[str]) -> list[str]:
    """Return a name for each run: the recorded one, of the same ones that of the folder.

    Where folders have the same name too, the folders above them tell them apart. Raises BagError
    for a bag that is given twice.
    """
    folders = [Path(os.path.abspath(path)) for path in paths]
    folders = [path.parent if path.suffix == '.mcap' else path for path in folders]
    for i, folder in enumerate(folders):
        if folder in folders[:i]:
            raise BagError(f'{paths[i]}: the bag is given twice')
    names, depth = list(recorded), 1
    while len(set(names)) < len(names):
        tails = ('/'.join(folder.parts[-depth:]) for folder in folders)
        names = [tail if recorded.count(n) > 1 else n for n, tail in zip(recorded, tails)]
        depth += 1
    return names


def compare_runs(
    runs: Sequence[EvaluatedDrive],
    out: Path,
    overlays: Sequence[Overlay] = (),
    singly: bool = False,
) -> Comparison:
    """Write the results of runs that have names and looks (`style.assign`) into the folder `out`.

    They are those of `compare_bags`. Of a run without tables and `run_info` the report shows
    neither horizon nor provenance.
    """
    scenario = runs[0].drive.facts.scenario
    by_run = {run.name: metrics.metrics_of(run) for run in runs}
    values = {'scenario': scenario, 'runs': by_run}
    values |= metrics_table.drives_of_paper(run.drive for run in runs)
    if overlays:
        values['overlays'] = {laid.name: [*laid.axes, *laid.signals] for laid in overlays}
    faults = {
        'damage': {run.name: run.damage for run in runs if run.damage},
        KEY: {run.name: run.invalid[KEY] for run in runs if run.invalid},
    }
    values |= {kind: by_name for kind, by_name in faults.items() if by_name}
    file, table_file, folder = out / FILE, out / metrics_table.CSV_FILE, out / FIGURES
    folder.mkdir(parents=True, exist_ok=True)
    try:
        replaced = tuple(json.loads(file.read_text())['runs'])
    except (OSError, ValueError, KeyError, TypeError):
        replaced = ()  # there is none to be read
    file.write_text(json.dumps(values, indent=2, allow_nan=False) + '\n')
    table_file.write_text(metrics_table.metrics_csv(by_run))
    drawn = comparison_figures.write_figures(runs, scenario, folder, overlays, singly)
    report = out / page.REPORT_FILE
    report.write_text(page.report_html(values, runs, overlays), encoding='utf-8')
    return Comparison(values, file, table_file, drawn, report, replaced)


def show_comparison(comparison: Comparison, console: Console, brief: bool = False) -> None:
    """Print the table and the paths of the files; `brief`: few metrics, verdicts, the report."""
    for damage in comparison.values.get('damage', {}).values():
        print_text(console, damage, 'red')
    console.print(metrics_table.build_table(comparison.values, brief))
    for name, run in comparison.values['runs'].items():
        print_text(console, f'{name}: {run["verdict"]}')
        if run['stopped_early'] and not brief:
            counts = f'{run["stopped_early"]} of {run["ticks"]} ticks'
            print_text(console, f'{name}: solver stopped early in {counts}')
    for name, invalid in comparison.values.get(KEY, {}).items():
        for line in describe_invalid({KEY: invalid}):
            print_text(console, f'{name}: {line}', 'red')
    if comparison.replaced and not brief:
        names = comparison.replaced
        listed = ', '.join(names) if len(names) <= style.MANY else f'{len(names)} runs'
        what = f'replaces the comparison that was there, of {listed}'
        print_text(console, f'{what}; --out DIR keeps both')
    places = {'numbers': comparison.file, 'as CSV': comparison.sheet}
    places['figures'] = comparison.figures[0]
    print_paths(console, {**({} if brief else places), 'report': comparison.report})
