"""What a search leaves behind: history, summary, figure, and controller files with the weights."""

import csv
import json
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from bags.errors import BagError
from experiments.configuration import node_config
from experiments.tuning import objective, search, space, tuned_file, tuning_figure
from experiments.tuning.search import Plan, Trial
from node_runtime import provenance

HISTORY, SUMMARY, SUFFIX = 'history.csv', 'tuning.json', '_tuned'
LIBRARIES = ('casadi', 'numpy', 'optuna', 'python')


class Result(NamedTuple):
    """What came out, and where it was written."""

    summary: dict[str, Any]  # tuning.json
    files: list[Path]  # controllers with the tuned weights
    figures: list[Path]


def write(
    plan: Plan, trials: Sequence[Trial], folder: Path, controllers: Path, also: Sequence[str]
) -> Result:
    """Write the history of the search in `folder` there, its controllers into `controllers`.

    These are <controller>_tuned.yaml. Each of `also` gets the tuned tolerances too, but keeps its
    own priorities. Raises BagError when no set of weights was safe.
    """
    summary = summarise(plan, trials, search.commit(folder))
    folder.mkdir(parents=True, exist_ok=True)
    _history(search.as_rows(trials), folder / HISTORY)
    (folder / SUMMARY).write_text(json.dumps(summary, indent=2) + '\n')
    figures = tuning_figure.write(plan.controller, trials, search.best(trials), folder)
    if not summary['best']['safe']:
        raise BagError(
            f'{plan.controller}: none of {len(trials)} sets of weights kept all safety '
            f'distances and the path; the history lies in {folder}, nothing was tuned'
        )
    weights = summary['best']['weights']
    tolerances = {n: value for n, value in weights.items() if n.startswith('tolerances.')}
    files = [_file(plan.controller, weights, summary, controllers)]
    files += [_file(name, tolerances, summary, controllers) for name in also]
    return Result(summary, files, figures)


def summarise(plan: Plan, trials: Sequence[Trial], commit: str) -> dict[str, Any]:
    """Return what a search came to, ready for JSON; the first trial is the untuned one.

    `commit` is that with which it was begun.
    """
    versions = {**provenance.versions(), 'optuna': metadata.version('optuna')}
    return {
        'controller': plan.controller,
        'command': command(plan),
        'plan': {**plan._asdict(), 'conditions': [c._asdict() for c in plan.conditions]},
        'drives': search.drives_of(plan),
        'safe_trials': sum(trial.safe for trial in trials),
        'untuned': _told(trials[0], plan),
        'after_stage_1': _told(search.best([t for t in trials if t.stage == 1]), plan),
        'best': _told(search.best(trials), plan),
        'versions': {name: versions[name] for name in LIBRARIES},
        'git_commit': commit,
    }


def command(plan: Plan) -> str:
    """Return the command that makes this search."""
    trials = ' '.join(map(str, plan.trials))
    return (
        f'experiments tune {plan.controller} --seed {plan.seed} --trials {trials} '
        f'--tracking {plan.tracking_m:g}'
    )


def _told(trial, plan):
    safety_m = space.safety(plan.controller)
    return {
        'stage': trial.stage,
        'trial': trial.number,
        'cost': trial.cost,
        'safe': trial.safe,
        'violated': list(objective.broken(trial.violations, plan.tracking_m, safety_m)),
        'weights': trial.weights,
        'drives': [score._asdict() for score in trial.scores],
    }


def _history(rows, path):
    with path.open('w', newline='') as file:
        writer = csv.DictWriter(file, rows[0], lineterminator='\n')
        writer.writeheader()
        writer.writerows(rows)


def _file(controller, weights, summary, folder):
    base = node_config.find_controller(controller).config
    path = folder / f'{base.stem}{SUFFIX}.yaml'
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(tuned_file.text(base.read_text(), weights, _header(base, weights, summary)))
    return path


def _header(base, weights, summary):
    before, after, plan = summary['untuned'], summary['best'], summary['plan']
    drives = ', '.join(
        f'{one["speed_kmh"]:g} km/h on grip {one["friction"]:g}' for one in plan['conditions']
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
