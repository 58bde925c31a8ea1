"""Compare runs from their bags: comparison.json, CSV, a table, figures and report.html."""

import json
import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from bags.command_line import print_paths, print_text
from bags.errors import BagError, DamagedBagWarning
from bags.evaluation import metrics
from bags.evaluation.controller_log import ControllerLog, read_controller_log
from bags.evaluation.drive import Drive, drive_from_bag, drop_nonfinite
from bags.figures import comparison_figures, panels, style
from bags.figures.overlay import Overlay, read_overlays
from bags.report import metrics_table, page
from bags.report.comparability import check_comparable
from bags.report.page import Claim
from bags.second_process import concurrently
from bags.storage import read
from bags.storage.invalid_messages import KEY, count_invalid, describe_invalid, drop_invalid

FILE = 'comparison.json'
FIGURES = 'figures'
NO_LOGS: Mapping[str, ControllerLog] = {}
NO_FAULTS: Mapping[str, Mapping[str, Any]] = {}


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
    claims_file: Path | None = None,
    overlay_files: Sequence[Path] = (),
) -> Comparison:
    """Compare the bags at `paths` and write the results into the folder `out`.

    They are comparison.json, comparison.csv, figures/ and report.html. The report also shows the
    claims in `claims_file`, by default a claims.json in `out` where there is one. The curves of the
    CSV files `overlay_files` (`figures.overlay`) are drawn beside those of the runs. Runs of one
    controller are called after their folders. Raises BagError for bags that cannot be evaluated,
    for one that is given twice, and for runs of different scenarios or plants (`force` compares
    them anyway, on the road of the first).
    """
    claims_file = claims_file or page.claims_beside(out)
    claimed = page.load_claims(claims_file) if claims_file else []
    with warnings.catch_warnings():
        # the damage is part of the results
        warnings.simplefilter('ignore', DamagedBagWarning)
        loaded = [drop_invalid(read.load(path)) for path in paths]
    if not force:
        check_comparable(paths, [bag.run_info for bag in loaded])
    driven = [drive_from_bag(bag) for bag in loaded]
    names = name_runs(paths, [drive.facts.controller for drive in driven])
    drives = dict(zip(names, driven))
    logs = {name: read_controller_log(bag) for name, bag in zip(names, loaded)}
    by_name = dict(zip(drives, loaded))
    invalid = {name: count_invalid(bag) for name, bag in by_name.items()}
    faults = {
        'damage': {name: bag.damage for name, bag in by_name.items() if bag.damage},
        KEY: {name: counts[KEY] for name, counts in invalid.items() if counts},
    }
    overlays = read_overlays(overlay_files, names, driven[0].scene) if overlay_files else ()
    return compare_drives(drives, out, faults, logs, claimed, overlays)


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


def compare_drives(
    drives: dict[str, Drive],
    out: Path,
    faults: Mapping[str, Mapping[str, Any]] = NO_FAULTS,
    logs: Mapping[str, ControllerLog] = NO_LOGS,
    claimed: Sequence[Claim] = (),
    overlays: Sequence[Overlay] = (),
) -> Comparison:
    """Evaluate drives by controller name and write the results into the folder `out`.

    `faults` of the bags by controller: `damage`, the position of the first one, and
    `invalid_messages`, those that were left out. `logs` by controller: without one the report
    shows neither horizon nor provenance of a drive.
    """
    drives = {name: drop_nonfinite(drive) for name, drive in drives.items()}
    scenario = next(iter(drives.values())).facts.scenario
    runs = panels.evaluate_runs(drives)
    by_run = {run.name: metrics.compute_metrics(run.drive, run.series) for run in runs}
    values = {'scenario': scenario, 'runs': by_run}
    values |= metrics_table.drives_of_paper(drives.values())
    if overlays:
        values['overlays'] = {
            overlay.name: [*overlay.axes, *overlay.signals] for overlay in overlays
        }
    values |= {kind: dict(by_name) for kind, by_name in faults.items() if by_name}
    out.mkdir(parents=True, exist_ok=True)
    file = out / FILE
    replaced = _compared_runs(file)
    file.write_text(json.dumps(values, indent=2, allow_nan=False) + '\n')
    table_file = out / metrics_table.CSV_FILE
    table_file.write_text(metrics_table.metrics_csv(by_run))
    folder = out / FIGURES
    folder.mkdir(exist_ok=True)
    costly = comparison_figures.COSTLY
    others = [name for name in comparison_figures.ALL if name not in costly]
    with concurrently(comparison_figures.write_figures, runs, scenario, folder, costly, overlays):
        comparison_figures.write_figures(runs, scenario, folder, others, overlays)
        data = page.ReportData(values, runs, logs, claimed, overlays)
        report = page.write_report(data, out / page.REPORT_FILE)
    drawn = [p for name in comparison_figures.ALL for p in style.figure_paths(folder / name)]
    return Comparison(values, file, table_file, drawn, report, replaced)


def _compared_runs(file):
    """Return the names of the runs in a comparison.json, () where there is none to be read."""
    try:
        return tuple(json.loads(file.read_text())['runs'])
    except (OSError, ValueError, KeyError, TypeError):
        return ()


def show_comparison(comparison: Comparison, console: Console) -> None:
    """Print the table and the paths of the files."""
    for damage in comparison.values.get('damage', {}).values():
        print_text(console, damage, 'red')
    console.print(metrics_table.build_table(comparison.values))
    for name, run in comparison.values['runs'].items():
        print_text(console, f'{name}: {run["verdict"]}')
        if run['stopped_early']:
            counts = f'{run["stopped_early"]} of {run["ticks"]} ticks'
            print_text(console, f'{name}: solver stopped early in {counts}')
    for name, invalid in comparison.values.get(KEY, {}).items():
        for line in describe_invalid({KEY: invalid}):
            print_text(console, f'{name}: {line}', 'red')
    if comparison.replaced:
        names = comparison.replaced
        listed = ', '.join(names) if len(names) <= style.MANY else f'{len(names)} runs'
        what = f'replaces the comparison that was there, of {listed}'
        print_text(console, f'{what}; --out DIR keeps both')
    figure = next(path for path in comparison.figures if path.suffix == '.png')
    places = {
        'numbers': comparison.file,
        'as CSV': comparison.sheet,
        'figures': figure,
        'report': comparison.report,
    }
    print_paths(console, places)
