"""In how many accepted settings does the car without collision avoidance reach the limit untouched?

    .venv/bin/python bench/limit_before_contact.py DIR [--jobs N]

DIR is that of `experiments study settings`. Contact is not simulated, and P3 counts the whole
drive, so that this car may reach the lateral limit behind obstacle 1, through which it went. Here
these drives are made again, and only what lies before the first contact counts. Prints how far the
settings at P3 get by then, and each claim in those that reach the limit of P3.
"""

import argparse
from pathlib import Path

import numpy as np
from rich.console import Console
from tables import TextTable, number, show

from bags.evaluation.metrics.driving import held_lat_acc_mps2
from bags.evaluation.metrics.registry import EvaluatedDrive
from bags.evaluation.series import compute_series
from experiments.settings import arms, drive
from experiments.settings import setting as settings
from experiments.settings.preconditions import ACCEPTED
from experiments.settings.preregistration import Preregistration
from experiments.settings.primaries import CLAIMS
from experiments.settings_analysis import study_tables
from experiments.worker_pool import WorkerPool

FIRST = 1  # id of the obstacle at the end of the first change


def share_before_contact(plan: Preregistration, seed: int, setting: int) -> float:
    """Return the lateral acceleration held for 0.1 s before contact, over the plant's limit."""
    (values,) = settings.draw(plan, seed, setting, 1)
    built = settings.build(plan, setting, values)
    driven, _ = drive.simulate(drive.plan_drive(plan, built, arms.NO_CA))
    facts = driven.facts._replace(circles=built.offsets, vehicle_radius=built.radius)
    driven = driven._replace(facts=facts)
    gaps = compute_series(driven)
    touches = (gaps.v2o[FIRST] < 0.0) | (gaps.outline_gaps[FIRST] < 0.0)
    contact_ns = driven.motion.stamp_ns[np.argmax(touches)]
    measured = driven.accelerations
    before = measured.stamp_ns < contact_ns
    untouched = driven._replace(
        accelerations=measured._replace(stamp_ns=measured.stamp_ns[before], ay=measured.ay[before])
    )
    held = EvaluatedDrive(untouched, gaps).value(held_lat_acc_mps2)
    return (held or 0.0) / built.plant.limit


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('folder', type=Path, metavar='DIR')
    parser.add_argument('--jobs', type=int, default=2, metavar='N')
    args = parser.parse_args()
    study = study_tables.load(args.folder)
    plan, own = study.plan, study.outcomes
    own = own[(own['baseline'] == arms.MATCHED) & (own['perturbation'] == 0)]
    own = study_tables.reaching(own, ACCEPTED, plan.decision.from_level)
    with WorkerPool(args.jobs) as pool:
        tasks = [(plan, study.seed, int(setting)) for setting in own['setting']]
        shares = np.array(pool.run(share_before_contact, tasks, lambda: None))
    least = plan.preconditions.P3.least_limit_share
    reaches = shares >= least
    console = Console()
    rows = [
        (f'{q:.0%}', number(float(np.quantile(shares, q)))) for q in (0.1, 0.25, 0.5, 0.75, 0.9)
    ]
    show(console, TextTable('Share of the limit before contact', ('quantile', 'share'), rows))
    console.print(f'{reaches.sum()} of {len(shares)} settings reach {least:g} before contact')
    rows = []
    for claim in CLAIMS:
        holds = own[f'{claim}.holds'].to_numpy(object)
        cells = [
            f'{sum(value is True or value == 1 for value in part)} of '
            f'{sum(value is not None and value == value for value in part)}'
            for part in (holds, holds[reaches])
        ]
        rows.append((claim, *cells))
    title = 'Claims, undisturbed: at P3, and where that car reaches the limit before contact'
    show(console, TextTable(title, ('claim', 'at P3', 'limit before contact'), rows))


if __name__ == '__main__':
    main()
