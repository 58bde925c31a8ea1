"""The command `experiments paper`: both experiments, distributions and claims, from nothing."""

import os
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from bags.errors import BagError
from experiments.paper import graph, point, readme
from experiments.progress import CountProgress
from experiments.study import claims, distributions, variants
from experiments.study.distributions import POINT_KPH
from experiments.study.drives import Drives

# who plays in the comparison: weights tuned with equal objective, budget and seed
ROLES = {name: f'{name}_tuned' for name in variants.CONTROLLERS}
ORDER = ('mpcc_no_ca', 'mpcc', 'frenet')  # the one that is overtaken in every panel lies below
BAGS, STUDY = 'bags', 'study'
COMMAND, QUICK = 'experiments paper', ' --quick'
RUNS, QUICK_RUNS = distributions.RUNS, 6
CAUSE_RUNS, QUICK_CAUSE_RUNS = 10, 2
VERDICTS = {'reproduced': 'green', 'partly': 'yellow', 'not': 'red'}  # the others are dim


class Made(NamedTuple):
    """What `experiments paper` made."""

    claims: Path  # claims.json
    rows: list[dict]
    figures: list[Path]


def everything(out: Path, quick: bool, jobs: int | None, console: Console) -> Made:
    """Make everything anew into the folder `out`. Raises BagError."""
    runs, cause_runs = (QUICK_RUNS, QUICK_CAUSE_RUNS) if quick else (RUNS, CAUSE_RUNS)
    speeds = distributions.SPEEDS_KPH[:1] if quick else distributions.SPEEDS_KPH
    bags, command = out / BAGS, COMMAND + (QUICK if quick else '')
    _say(console, '1/4 the operating point, in process')
    point.write(out)
    _say(console, f'2/4 distributions of {runs} paired runs and their causes')
    with CountProgress(console) as bars, Drives(jobs, bars.show) as drives:
        cast = variants.cast(ROLES)
        found = distributions.run(drives, out / STUDY, cast, runs, speeds, command=command)
        told = claims.run(drives, out, runs, cause_runs, speeds, ROLES, command=command)
    _say(console, '3/4 experiment 2 through the node graph, as the median run')
    driven = graph.double_lane_change(
        [found.median_case(role) for role in ORDER], out, bags, console
    )
    _agree(found, driven)
    _say(console, '4/4 experiment 1 through the node graph')
    graph.circle(out, bags, console)
    return Made(out / f'{claims.STEM}.json', told.rows, driven.figures)


def _agree(found, driven):
    """Raise BagError when the node graph did not drive what was driven in process."""
    for role in ORDER:
        one = found.median_case(role)
        (record,) = (run for run in found.records[POINT_KPH][role] if run.case == one)
        known, seen = point.numbers(record.metrics), point.numbers(driven.metrics[one.controller])
        for deviation in point.deviations(one.controller, known, seen):
            raise BagError(f'node graph and ring in process differ: {deviation}')


def _say(console, text):
    console.print(text, style='bold')


def show(made: Made, console: Console) -> None:
    """Print the claims with why some are not decided, and where everything is."""
    table = Table(title='The claims of the paper', title_justify='left', show_lines=True)
    table.add_column('claim, what the paper says, what comes out here', overflow='fold')
    table.add_column('verdict', no_wrap=True)
    table.add_column('holds in runs', no_wrap=True)
    for row in made.rows:
        verdict = f'[{VERDICTS.get(row["verdict"], "dim")}]{row["verdict"]}[/]'
        # brackets are ranges, not markup
        paper, ours = (escape(row[name]) for name in ('paper', 'ours'))
        told = f'[bold]{row["claim"]}[/]\n[dim]paper[/] {paper}\n[dim]ours [/] {ours}'
        table.add_row(told, verdict, escape(row['interval']))
    console.print(table)
    console.print(claims.undecided(made.rows), markup=False, highlight=False)
    sheet = next(path for path in made.figures if path.suffix == '.png')
    for label, path in (('claims', made.claims), ('figures', sheet)):
        console.print(f'{label}: {os.path.relpath(path)}', markup=False, highlight=False)


def rewritten(file: Path, out: Path) -> None:
    """Put the claims that lie in the folder `out` into a Markdown file. Raises BagError."""
    readme.rewrite(file, out / f'{claims.STEM}.json')
