"""`experiments tune`: the weights of a controller, by the search of the study (docs/study.md).

Tasks, ranges, cost and budget are those of a plan, so what is found can be compared with the
study's. Untuned and tuned weights then drive the same fresh tasks.
"""

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from experiments.configuration import inputs, node_config
from experiments.pool import Pool
from experiments.row_runner import DriveRecords
from experiments.tuned_study import arms, run
from experiments.tuned_study.arms import Driver
from mpcc_controller.problem import formulation
from msgs_yaml import share
from node_runtime import parameters

FRESH = 1_000_000  # added to the seed of the search: that of the tasks that judge
HISTORY, SUFFIX = 'trials.csv', '_tuned'
WIDTH = 100  # of the comments in a controller file


class Tuned(NamedTuple):
    """What a search found."""

    before: Mapping[str, float]  # the weights of the file, by dotted name
    weights: Mapping[str, float]
    avoided: tuple[float, float]  # share of fresh tasks, before and with the weights
    file: Path  # a controller with the weights
    history: Path  # every point of the search, as CSV


def tune(
    plan: Mapping[str, Any],
    controller: str,
    seed: int,
    folder: Path,
    pool: Pool,
) -> Tuned:
    """Search, judge and write; an interrupted call goes on in its folder.

    plan        with `search`, `starts` and `judged_tasks` as in paper/study/study.yaml
    controller  a name or a YAML file; its other parameters stay
    seed        of tasks and search
    folder      receives <controller>_tuned.yaml, the history and the records of drives

    Raises BagError for an unknown controller, for a drive that fails for another reason than its
    weights, and while another program searches in the folder.
    """
    base = node_config.find_controller(controller).config
    values = parameters.flatten(inputs.controller_params(controller))
    names = formulation.find(values['formulation.name']).tuned_weights
    if values['formulation.heading']:
        names = {*names, arms.HEADING}
    ranges, count = plan['search']['ranges'], plan['judged_tasks']
    arm = base.stem
    without = [name for name in ranges if name not in names]
    own = {**plan, 'tuned': {arm: {'controller': controller, 'without': without}}, 'derived': {}}
    with DriveRecords(folder) as records:
        driver = Driver(records, pool)
        trials = run.search_arm(own, arm, seed, driver)
        weights = trials[-1].weights
        before = {name: float(values[name]) for name in weights}
        avoided = []
        for chosen in (before, weights):
            rows = [
                arms.row(own, arm, chosen, seed + FRESH, index, labels=chosen.items())
                for index in range(count)
            ]
            outcomes = driver.drive(rows)
            avoided.append(sum(outcome['avoided'] for outcome in outcomes) / count)
    history, file = folder / HISTORY, folder / f'{arm}{SUFFIX}.yaml'
    run.as_frame((arm, trial) for trial in trials).to_csv(history, index=False)
    header = [
        f'{base.name} with the weights of `experiments tune {controller} --seed {seed}`.',
        f'Of {count} fresh tasks {base.name} avoids {avoided[0]:.0%}, this file {avoided[1]:.0%}.',
    ]
    file.write_text(controller_text(base, weights, header))
    return Tuned(before, weights, tuple(avoided), file, history)


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
