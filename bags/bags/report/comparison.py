"""Compare runs offline, from their bags alone: JSON, CSV, a table, figures and a report."""

import json
import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from bags.errors import BagError, DamagedBagWarning
from bags.evaluation import metrics
from bags.evaluation.controller_log import ControllerLog, read_controller_log
from bags.evaluation.drive import Drive, drive_from_bag, drop_nonfinite
from bags.evaluation.series import compute_series
from bags.figures import comparison_figures, panels, style
from bags.report import metrics_table, page
from bags.report.comparability import check_comparable
from bags.report.page import Claim
from bags.storage import read
from bags.storage.invalid_messages import KEY, count_invalid, describe_invalid, drop_invalid

FILE = 'comparison.json'
FIGURES = 'figures'
NO_LOGS: Mapping[str, ControllerLog] = {}
NO_FAULTS: Mapping[str, Mapping[str, Any]] = {}


class Comparison(NamedTuple):
    """What came out, and where it was written."""

    values: dict[str, Any]  # comparison.json
    file: Path
    sheet: Path
    figures: list[Path]
    report: Path


def compare_bags(
    paths: Sequence[Path | str],
    out: Path,
    force: bool = False,
    claims_file: Path | None = None,
) -> Comparison:
    """Compare the bags at `paths` and write what came out into the folder `out`.

    That is comparison.json, comparison.csv, figures/ and report.html. The report also shows the
    claims in `claims_file`, by default a claims.json in `out` where there is one. Raises BagError
    for bags that cannot be judged, that name the same controller twice, or that drove unlike
    scenarios or plants (`force` compares them all the same, on the road of the first).
    """
    claims_file = claims_file or page.claims_beside(out)
    claimed = page.load_claims(claims_file) if claims_file else []
    with warnings.catch_warnings():
        # the damage is part of what comes out
        warnings.simplefilter('ignore', DamagedBagWarning)
        loaded = [drop_invalid(read.load(path)) for path in paths]
    if not force:
        check_comparable(paths, [bag.run_info for bag in loaded])
    drives, logs = {}, {}
    for path, bag in zip(paths, loaded):
        found = drive_from_bag(bag)
        name = found.facts.controller
        if name in drives:
            raise BagError(f'{path}: another bag also holds a run of {name}; compare one of them')
        drives[name] = found
        logs[name] = read_controller_log(bag)
    of_bags = dict(zip(drives, loaded))
    counts = {name: count_invalid(bag) for name, bag in of_bags.items()}
    faults = {
        'damage': {name: bag.damage for name, bag in of_bags.items() if bag.damage},
        KEY: {name: found[KEY] for name, found in counts.items() if found},
    }
    return compare_drives(drives, out, faults, logs, claimed)


def compare_drives(
    drives: dict[str, Drive],
    out: Path,
    faults: Mapping[str, Mapping[str, Any]] = NO_FAULTS,
    logs: Mapping[str, ControllerLog] = NO_LOGS,
    claimed: Sequence[Claim] = (),
) -> Comparison:
    """Judge drives by controller name and write what came out into the folder `out`.

    `faults` say by controller what is wrong with a bag: `damage`, up to which place it was read,
    and `invalid_messages`, what was left out of it. `logs` are what the report shows beyond the
    drives: a drive without one has neither horizon nor provenance there.
    """
    drives = {name: drop_nonfinite(one) for name, one in drives.items()}
    scenario = next(iter(drives.values())).facts.scenario
    colours = style.assign_colours(list(drives))
    runs = [panels.Run(n, one, compute_series(one), colours[n]) for n, one in drives.items()]
    found = {run.name: metrics.compute_metrics(run.drive, run.series) for run in runs}
    values = {'scenario': scenario, 'runs': found}
    values |= {kind: dict(found) for kind, found in faults.items() if found}
    out.mkdir(parents=True, exist_ok=True)
    file = out / FILE
    file.write_text(json.dumps(values, indent=2, allow_nan=False) + '\n')
    table_file = out / metrics_table.CSV_FILE
    table_file.write_text(metrics_table.metrics_csv(found))
    drawn = comparison_figures.write_figures(runs, scenario, out / FIGURES)
    report = page.write_report(page.ReportData(values, runs, logs, claimed), out / page.REPORT_FILE)
    return Comparison(values, file, table_file, drawn, report)


def show_comparison(comparison: Comparison, console: Console) -> None:
    """Print the table, and where the files are."""
    for damage in comparison.values.get('damage', {}).values():
        console.print(damage, style='red', markup=False, highlight=False, soft_wrap=True)
    console.print(metrics_table.build_table(comparison.values))
    for name, found in comparison.values['runs'].items():
        console.print(f'{name}: {found["verdict"]}', markup=False, highlight=False, soft_wrap=True)
    for name, found in comparison.values.get(KEY, {}).items():
        for line in describe_invalid({KEY: found}):
            line = f'{name}: {line}'
            console.print(line, style='red', markup=False, highlight=False, soft_wrap=True)
    figure = next(path for path in comparison.figures if path.suffix == '.png')
    places = {
        'numbers': comparison.file,
        'as CSV': comparison.sheet,
        'figures': figure,
        'report': comparison.report,
    }
    for label, path in places.items():
        console.print(f'{label}: {os.path.relpath(path)}', markup=False, highlight=False)
