"""The command `experiments tune`: search, show how far it is, and write what came out."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from experiments.configuration import node_config
from experiments.tuning import result, search
from experiments.tuning.objective import Condition
from experiments.tuning.result import Result
from experiments.tuning.search import Plan, Trial
from experiments.worker_pool import WorkerPool

RANDOM = (18, 6)  # trials of each stage before its model begins to choose
BATCH = 4


class Asked(NamedTuple):
    """What `experiments tune` is asked for."""

    controller: str
    seed: int
    trials: tuple[int, int]  # of each stage
    tracking_m: float  # rms distance from the coarse path that is allowed
    jobs: int
    folder: Path  # of the history
    controllers: Path  # that receives the tuned files
    also: Sequence[str]


def plan(asked: Asked, conditions: Sequence[Condition]) -> Plan:
    """Return the plan that follows from what is asked for."""
    return Plan(
        asked.controller,
        asked.seed,
        asked.trials,
        RANDOM,
        BATCH,
        tuple(conditions),
        asked.tracking_m,
    )


def tune(asked: Asked, conditions: Sequence[Condition], console: Console) -> Result:
    """Tune and write; raises BagError, and KeyboardInterrupt that says how to go on."""
    for name in (asked.controller, *asked.also):
        node_config.find_controller(name)
    made = plan(asked, conditions)
    bars = Progress(
        TextColumn('{task.description}', style='bold'),
        BarColumn(24),
        MofNCompleteColumn(),
        TextColumn('drives'),
        TimeRemainingColumn(),
        TextColumn('{task.fields[said]}'),
        console=console,
        disable=not console.is_terminal,
    )
    trials: list[Trial] = []
    try:
        with bars, WorkerPool(asked.jobs) as pool:
            task = bars.add_task(asked.controller, total=search.drives_of(made), said='')

            def on_drive():
                bars.advance(task)

            def on_trial(trial):
                trials.append(trial)
                done = len(trials) * len(made.conditions)
                bars.update(task, completed=done, said=_said(trials))
                if not console.is_terminal and len(trials) % (4 * BATCH) == 0:
                    console.print(f'{len(trials)} of {sum(made.trials)} trials, {_said(trials)}')

            search.run(made, asked.folder, pool, on_drive, on_trial)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            f'{len(trials)} of {sum(made.trials)} trials are kept; the same command goes on'
        ) from None
    return result.write(made, trials, asked.folder, asked.controllers, asked.also)


def _said(trials):
    best = search.best(trials)
    before, after = (
        f'{one.cost:.3f}{"" if one.safe else " (infeasible)"}' for one in (trials[0], best)
    )
    return f'objective {before} -> {after}'


def show(found: Result, console: Console) -> None:
    """Print weights before and after, and where everything is."""
    summary = found.summary
    table = Table(title=f'{summary["controller"]}: untuned and tuned', title_justify='left')
    table.add_column('', no_wrap=True)
    for name in ('untuned', 'tuned'):
        table.add_column(name, justify='right')
    columns = (summary['untuned'], summary['best'])
    table.add_row('objective', *(f'{column["cost"]:.3f}' for column in columns))
    table.add_row('constraints', *('kept' if one['safe'] else 'infeasible' for one in columns))
    for name in columns[0]['weights']:
        table.add_row(name, *(f'{column["weights"][name]:g}' for column in columns))
    console.print(table)
    for name, column in zip(('untuned', 'tuned'), columns):
        if not column['safe']:
            told = f'{name}: infeasible, {", ".join(column["violated"])}'
            console.print(f'{told}; its objective does not count', highlight=False, soft_wrap=True)
    for label, paths in (('controllers', found.files), ('history', found.figures[:1])):
        shown = ', '.join(os.path.relpath(path) for path in paths)
        console.print(f'{label}: {shown}', markup=False, highlight=False, soft_wrap=True)
