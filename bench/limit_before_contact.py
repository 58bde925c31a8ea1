"""In how many accepted settings is the lateral limit reached before the car meets an obstacle?

    .venv/bin/python bench/limit_before_contact.py DIR... [--jobs N] [--figure STEM]
    .venv/bin/python bench/limit_before_contact.py --page docs/threats.md

DIR is that of `experiments study settings`. Contact is not simulated, and P3 counts the whole
drive, so that the car without collision avoidance may reach the lateral limit behind obstacle 1,
through which it went. The tables have no time of it. So the undisturbed drives of the settings at
P3 are made again, and only what lies before an obstacle counts: before the first contact of
circles or outline with it, or, where there is none, before the nearest approach. Prints both counts
for each car, and each claim in the settings in which the car without avoidance reaches the limit of
P3 untouched; writes limit_before_contact.json and a figure. --page drives nothing: it writes the
table between the comments of a page.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import approach_drives
import matplotlib as mpl
import numpy as np
from approach_drives import Approach
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from rich.console import Console
from tables import TextTable, markdown, number, show

from bags.figures import style
from experiments import page_block
from experiments.pool import Pool
from experiments.progress import CountProgress
from experiments.settings import arms
from experiments.settings.preconditions import ACCEPTED
from experiments.settings.primaries import CLAIMS
from experiments.settings_analysis import study_tables
from experiments.settings_analysis.study_tables import Study
from experiments.statistical_inference import wilson_interval

CARS = (arms.NO_CA, arms.MPCC, arms.MATCHED)
FILE = Path(__file__).with_suffix('.json')
BLOCK = 'limit before contact'
TITLES = {
    'before_1': 'before obstacle 1',
    'before_2': 'before obstacle 2',
    'whole': 'whole drive',
}
COLOURS = {arms.NO_CA: '#4D4D4D', arms.MPCC: '#0072B2', arms.MATCHED: '#D55E00'}


def measure(study: Study, pool: Pool, progress: CountProgress) -> dict[str, Any]:
    """Drive the settings of a study at P3 again; return what the file has of its run."""
    done, plan, own = [], study.plan, study.outcomes
    own = own[(own['baseline'] == arms.MATCHED) & (own['perturbation'] == 0)]
    own = study_tables.reaching(own, ACCEPTED, plan.decision.from_level)
    tasks = [(plan, study.seed, int(setting), CARS) for setting in own['setting']]

    def on_done():
        done.append(study.run)
        progress.show(study.run, len(done), len(tasks))

    driven = pool.run(approach_drives.measure, tasks, on_done)
    shares = np.array(driven).round(4).reshape(-1, len(CARS), len(Approach._fields))
    least = plan.preconditions.P3.least_limit_share
    untouched = shares[:, CARS.index(arms.NO_CA), 0] >= least
    return {
        'least_share': least,
        'settings': len(shares),
        'shares': {
            car: {name: shares[:, k, i].tolist() for i, name in enumerate(Approach._fields)}
            for k, car in enumerate(CARS)
        },
        'claims': {
            claim: {
                'all': _count(own[f'{claim}.holds']),
                'untouched': _count(own.loc[untouched, f'{claim}.holds']),
            }
            for claim in CLAIMS
        },
    }


def _count(holds):
    known = holds.dropna().astype(bool)
    return [int(known.sum()), len(known)]


def reached(run: Mapping[str, Any], car: str, until: str) -> tuple[int, float, float]:
    """Return in how many settings a car reaches the limit by then, and the share's interval."""
    count = int((np.array(run['shares'][car][until]) >= run['least_share']).sum())
    return count, *wilson_interval(count, run['settings'])


def limit_table(runs: Mapping[str, Any]) -> TextTable:
    """Return how many settings reach the limit by when, per run and car."""
    rows = []
    for name, run in runs.items():
        for car in CARS:
            cells = []
            for until in Approach._fields:
                count, low, high = reached(run, car, until)
                cells.append(f'{count} of {run["settings"]} ({100 * low:.0f}–{100 * high:.0f} %)')
            median = float(np.median(run['shares'][car]['before_1']))
            rows.append((name, f'`{car}`', *cells, number(median)))
    columns = ('run', 'car', *TITLES.values(), 'median share before obstacle 1')
    return TextTable('Settings at P3 in which the car holds the limit', columns, rows)


def claim_table(runs: Mapping[str, Any]) -> TextTable:
    """Return each claim at P3, and where the car without avoidance is at the limit untouched."""
    rows = [
        (name, f'`{claim}`', *('{} of {}'.format(*counts[part]) for part in ('all', 'untouched')))
        for name, run in runs.items()
        for claim, counts in run['claims'].items()
    ]
    columns = ('run', 'claim, undisturbed', 'at P3', 'of them at the limit before contact')
    return TextTable('Claims where that car is at the limit before contact', columns, rows)


def page_text(runs: Mapping[str, Any]) -> str:
    """Return the block of a page."""
    tables = [markdown(table(runs)) for table in (limit_table, claim_table)]
    # the headings are those of the page
    return '\n' + '\n'.join(text.partition('\n\n')[2] for text in tables)


def write_figure(runs: Mapping[str, Any], stem: Path) -> list[Path]:
    """Draw the distribution of each car's share before obstacle 1; return the paths."""
    dashes = {'before_1': '-', 'whole': (0, (2, 2))}
    with mpl.rc_context(style.RC):
        figure = Figure(figsize=(1.6 + 4.6 * len(runs), 4.0), layout='constrained')
        panels = figure.subplots(1, len(runs), squeeze=False, sharex=True, sharey=True)[0]
        for axes, (name, run) in zip(panels, runs.items()):
            for car in CARS:
                for until, dash in dashes.items():
                    shares = np.sort(run['shares'][car][until])
                    part = 1.0 - np.arange(len(shares)) / len(shares)
                    axes.step(shares, part, ls=dash, color=COLOURS[car], lw=1.5)
            axes.axvline(run['least_share'], color=style.EDGE, lw=0.9)
            axes.set_title(f'{name}, {run["settings"]} settings at P3')
            axes.set(xlim=(0.5, 1.2), ylim=(0.0, 1.02))
            axes.set_xlabel("lateral acceleration held for 0.1 s / plant's limit")
        panels[0].set_ylabel('share of settings with at least that')
        keys = [Line2D([], [], color=COLOURS[car], label=car) for car in CARS]
        keys += [
            Line2D([], [], color=style.QUIET, ls=dash, label=TITLES[until])
            for until, dash in dashes.items()
        ]
        panels[0].legend(handles=keys, loc='lower left')
        return style.save_figure(figure, stem)


def _drive(folders: Sequence[Path], jobs: int, console: Console) -> dict[str, Any]:
    studies = [study_tables.load(folder) for folder in folders]
    with CountProgress(console) as progress, Pool(jobs) as pool:
        return {study.run: measure(study, pool, progress) for study in studies}


def main() -> None:
    """Drive and write the file, or write the page from it."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('folders', nargs='*', type=Path, metavar='DIR')
    parser.add_argument('--jobs', type=int, default=2, metavar='N')
    parser.add_argument('--figure', type=Path, metavar='STEM', help='writes STEM.png and .svg')
    parser.add_argument('--page', type=Path, metavar='FILE')
    args = parser.parse_args()
    console = Console()
    if args.folders:
        runs = _drive(args.folders, args.jobs, console)
        FILE.write_text(json.dumps(runs, indent=1) + '\n')
    else:
        runs = json.loads(FILE.read_text())
    for table in (limit_table(runs), claim_table(runs)):
        show(console, table)
    if args.figure:
        write_figure(runs, args.figure)
    if args.page:
        page_block.replace(args.page, BLOCK, page_text(runs))


if __name__ == '__main__':
    main()
