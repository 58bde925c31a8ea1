"""`experiments tune`: search with progress; write history, summary, figure and controller files."""

import json
import os
import textwrap
from collections.abc import Mapping, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from rich.console import Console
from rich.table import Table

from bags.command_line import print_text
from bags.errors import BagError
from experiments.configuration import inputs, node_config
from experiments.pool import Pool
from experiments.progress import CountProgress
from experiments.tuning import problem, tuning_figure, weight_search
from experiments.tuning.weight_search import SearchPlan, Trial
from msgs_yaml import share
from node_runtime import parameters, provenance

RANDOM = (18, 6)  # trials of each stage before its model begins to choose
BATCH = 4
LINE_EVERY = 4 * BATCH  # trials, without a terminal
HISTORY, SUMMARY, SUFFIX = 'history.csv', 'tuning.json', '_tuned'
LIBRARIES = ('casadi', 'numpy', 'optuna', 'python')
WIDTH = 100  # of the comments in a controller file


class Result(NamedTuple):
    """The result of a search, and its files."""

    summary: dict[str, Any]  # tuning.json
    files: list[Path]  # controllers with the tuned weights
    figures: list[Path]


def tune(
    plan: SearchPlan,
    jobs: int,
    folder: Path,
    controllers: Path,
    also: Sequence[str],
    console: Console,
) -> Result:
    """Search with `jobs` processes, write as `write`; return the result.

    Raises BagError, and KeyboardInterrupt that says how to continue.
    """
    for name in (plan.controller, *also):
        node_config.find_controller(name)
    trials: list[Trial] = []
    runs = 0
    with CountProgress(console) as progress, Pool(jobs) as pool:

        def show():
            note = _cost_note(trials) if trials else ''
            progress.show(f'{plan.controller}, drives', runs, plan.runs, note)

        def on_run():
            nonlocal runs
            runs += 1
            show()

        def on_trial(trial):
            nonlocal runs
            trials.append(trial)
            runs = len(trials) * len(plan.conditions)
            show()
            if len(trials) % LINE_EVERY == 0:
                done = f'{len(trials)} of {sum(plan.trials)} trials'
                progress.print_line(f'{done}, {_cost_note(trials)}')

        try:
            weight_search.run(plan, folder, pool, on_run, on_trial)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                f'{len(trials)} of {sum(plan.trials)} trials are kept; the same command goes on'
            ) from None
    return write(plan, trials, folder, controllers, also)


def _cost_note(trials):
    before, after = (
        f'{trial.cost:.3f}{"" if trial.is_feasible else " (infeasible)"}'
        for trial in (trials[0], weight_search.find_best(trials))
    )
    return f'objective {before} -> {after}'


def write(
    plan: SearchPlan, trials: Sequence[Trial], folder: Path, controllers: Path, also: Sequence[str]
) -> Result:
    """Write the history of the search into `folder`, its controllers into `controllers`.

    These are <controller>_tuned.yaml. Each of `also` gets the tuned tolerances, too, but keeps its
    own priorities. Raises BagError when no set of weights is feasible.
    """
    summary = summarise(plan, trials)
    weight_search.as_table(trials).to_csv(folder / HISTORY, index=False)
    (folder / SUMMARY).write_text(json.dumps(summary, indent=2) + '\n')
    figures = tuning_figure.write(plan.controller, trials, weight_search.find_best(trials), folder)
    if not summary['best']['safe']:
        raise BagError(
            f'{plan.controller}: none of {len(trials)} sets of weights kept all safety '
            f'distances and the path; the history is in {folder}, nothing was tuned'
        )
    weights = summary['best']['weights']
    tolerances = {n: value for n, value in weights.items() if n.startswith('tolerances.')}
    files = [_write_controller(plan.controller, weights, summary, controllers)]
    files += [_write_controller(name, tolerances, summary, controllers) for name in also]
    return Result(summary, files, figures)


def summarise(plan: SearchPlan, trials: Sequence[Trial]) -> dict[str, Any]:
    """Return the summary of a search, ready for JSON; the first trial is the untuned one."""
    versions = {**provenance.versions(), 'optuna': metadata.version('optuna')}
    first_stage = [trial for trial in trials if trial.stage == 1]
    return {
        'controller': plan.controller,
        'command': (
            f'experiments tune {plan.controller} --seed {plan.seed} --trials '
            f'{" ".join(map(str, plan.trials))} --tracking {plan.tracking_m:g}'
        ),
        'plan': {**plan._asdict(), 'conditions': [c._asdict() for c in plan.conditions]},
        'drives': plan.runs,
        'safe_trials': sum(trial.is_feasible for trial in trials),
        'untuned': _trial_summary(trials[0], plan),
        'after_stage_1': _trial_summary(weight_search.find_best(first_stage), plan),
        'best': _trial_summary(weight_search.find_best(trials), plan),
        'versions': {name: versions[name] for name in LIBRARIES},
        'git_commit': provenance.commit(),
    }


def _trial_summary(trial, plan):
    safety = inputs.controller_params(plan.controller).safety
    safety_m = {'v2o': safety.obstacle_m, 'v2e': safety.edge_m}
    violated = problem.describe_violations(trial.violations, plan.tracking_m, safety_m)
    return {
        'stage': trial.stage,
        'trial': trial.number,
        'cost': trial.cost,
        'safe': trial.is_feasible,
        'violated': list(violated),
        'weights': trial.weights,
        'drives': [score._asdict() for score in trial.scores],
    }


def _write_controller(controller, weights, summary, folder):
    base = node_config.find_controller(controller).config
    path = folder / f'{base.stem}{SUFFIX}.yaml'
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(controller_text(base, weights, _header(base, weights, summary)))
    return path


def controller_text(base: Path, weights: Mapping[str, float], header: Sequence[str]) -> str:
    """Return the text of a controller file that changes `weights`, by dotted name, of its base.

    `header` are paragraphs of the comment at its head. Raises KeyError for a name that the base
    does not have.
    """
    config = share.path('mpcc_controller', 'config')
    known = parameters.read_file(base, config).values
    # a base in config/ is found by its name from anywhere
    values: dict[str, Any] = {'base': base.name if base.parent == config else str(base)}
    for name, value in weights.items():
        if name not in known:
            raise KeyError(name)
        group, _, key = name.partition('.')
        values.setdefault(group, {})[key] = float(value)
    lines = [line for paragraph in header for line in textwrap.wrap(paragraph, WIDTH - 2)]
    document = yaml.safe_dump({'/**': {'ros__parameters': values}}, sort_keys=False)
    return ''.join(f'# {line}\n' for line in lines) + document


def _header(base, weights, summary):
    before, after, plan = summary['untuned'], summary['best'], summary['plan']
    drives = ', '.join(
        f'{run["speed_kmh"]:g} km/h on grip {run["friction"]:g}' for run in plan['conditions']
    )
    versions = ', '.join(f'{name} {version}' for name, version in summary['versions'].items())
    kept = '' if before['safe'] else f' (infeasible: {", ".join(before["violated"])})'
    return [
        f'{base.name} with weights from Bayesian optimisation in two stages (docs/paper.md).',
        f'Made by: {summary["command"]}',
        f'Budget: {sum(plan["trials"])} sets of weights, {summary["drives"]} drives: {drives}.',
        'Objective: mean of rms velocity error / 1 m/s + peak sideslip angle / 3 deg, all safety '
        f'distances kept and the coarse path tracked to {plan["tracking_m"]:g} m rms: '
        f'{before["cost"]:.3f} with {summary["controller"]}.yaml{kept}, '
        f'{after["cost"]:.3f} with these weights.',
        f'Changed: {", ".join(weights)}.',
        f'Versions: {versions}; commit {summary["git_commit"] or "unknown"}.',
    ]


def show(result: Result, console: Console) -> None:
    """Print weights before and after, and the paths of controllers and history."""
    summary = result.summary
    table = Table(title=f'{summary["controller"]}: untuned and tuned', title_justify='left')
    table.add_column('', no_wrap=True)
    columns = {'untuned': summary['untuned'], 'tuned': summary['best']}
    for name in columns:
        table.add_column(name, justify='right')
    cells = columns.values()
    table.add_row('objective', *(f'{column["cost"]:.3f}' for column in cells))
    table.add_row('constraints', *('kept' if column['safe'] else 'infeasible' for column in cells))
    for name in summary['best']['weights']:
        table.add_row(name, *(f'{column["weights"][name]:g}' for column in cells))
    console.print(table)
    for name, column in columns.items():
        if not column['safe']:
            text = f'{name}: infeasible, {", ".join(column["violated"])}'
            console.print(f'{text}; its objective does not count', highlight=False, soft_wrap=True)
    for label, paths in (('controllers', result.files), ('history', result.figures[:1])):
        shown = ', '.join(os.path.relpath(path) for path in paths)
        print_text(console, f'{label}: {shown}')
