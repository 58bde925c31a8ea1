"""Several controllers through one scenario, one after the other, and the comparison of them."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from bags.errors import BagError
from experiments.configuration import experiment, inputs
from experiments.run import domain, folders, node_graph
from experiments.run.interrupt import Interrupt, Interrupted
from experiments.run.progress import Progress
from stage_solver import compile_cache

NO_COMPILER = (
    '[yellow]no C compiler found:[/] plant and controller run interpreted, several times slower; '
    'what they compute stays the same. On Debian and Ubuntu: apt install gcc'
)
WARNING = '[yellow]warning, {}:[/] '


class Plan(NamedTuple):
    """What `experiments run` is asked for."""

    scenario: str  # a name, or the path of a file
    controllers: Sequence[str]  # names in mpcc_controller/config, or paths
    mode: str
    out: Path
    settings: Sequence[str]  # NODE.parameter=value
    time_limit_s: float  # of wall time per run
    markers: bool = False  # whether a node draws the ring for 3D viewers


def run_all(plan: Plan, console: Console) -> int:
    """Make the runs, compare those that left a bag; return 0 when all were completed.

    A car that crosses the finish line beside the road has not completed: a line says so.
    Raises BagError for a scenario, controller, setting or folder that cannot be used, before
    anything is started, and Interrupted, which says what was kept, when a signal came; no process
    is left behind in any case.
    """
    folder, outcomes = run_nodes(plan, console)
    made = _made(outcomes)
    completed = [outcome.completed for outcome in outcomes]
    if made:
        # figures and report take seconds to import: an error in the input must not wait for them
        from bags.report import compare

        try:
            compared = compare.bags(made, folder)
        except Exception as error:
            kept = ' '.join(os.path.relpath(bag) for bag in made)
            raise BagError(f'the comparison failed: {error}; kept: {kept}') from error
        compare.show(compared, console)
        runs = compared.values['runs']
        completed += [found['completed'] for found in runs.values()]
        _show_disagreement(outcomes, runs, console)
    return 0 if all(completed) else 1


def _show_disagreement(outcomes, runs, console):
    """Say of which run only the comparison knows that it was not completed: the exit code is 1."""
    for outcome in outcomes:
        found = runs.get(outcome.controller)
        if outcome.completed and found and not found['completed']:
            console.print(
                f'{outcome.controller}: not completed, although the plant reports '
                f'"{outcome.message}": {found["verdict"]}; the exit code is 1',
                markup=False,
                highlight=False,
                soft_wrap=True,
            )


def run_nodes(plan: Plan, console: Console) -> tuple[Path, list[node_graph.Outcome]]:
    """Make the runs as `run_all` does; return the folder of the scenario and how each ended."""
    chosen = experiment.controllers(plan.controllers)
    overrides = experiment.overrides(plan.settings)
    facts = inputs.scenario_facts(plan.scenario)
    folder = plan.out / facts.name
    file_values = {}
    for controller in chosen:
        ring = experiment.nodes(facts, controller, plan.mode, folder, folder, overrides)
        read = inputs.check_parameters(ring)
        file_values[controller.name] = inputs.file_values(read)
        for text in inputs.warnings_of(facts, read):
            console.print(WARNING.format(controller.name), end='')
            console.print(text, markup=False, highlight=False, soft_wrap=True)
    with folders.created(folder, f'--out {plan.out}'):
        return folder, _run_each(plan, facts, chosen, file_values, overrides, folder, console)


def _run_each(plan, facts, chosen, file_values, overrides, folder, console):
    for line in folders.recover(folder):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    if compile_cache.find_compiler() is None:
        console.print(NO_COMPILER)
    outcomes = []
    try:
        with (
            Interrupt() as interrupt,
            Progress(console) as progress,
            domain.reserved(os.environ) as number,
        ):
            settings = node_graph.Settings(
                plan.mode,
                folder.absolute(),
                overrides,
                number,
                plan.time_limit_s,
                plan.markers,
            )
            for controller in chosen:
                progress.begin(controller.name, facts.length_m)
                outcome = node_graph.one(
                    facts,
                    controller,
                    file_values[controller.name],
                    settings,
                    interrupt,
                    progress,
                )
                progress.end(outcome.controller, outcome.completed, outcome.message)
                outcomes.append(outcome)
    except Interrupted as interrupted:
        bags = _made(outcomes) + [bag for bag in (interrupted.kept,) if bag]
        kept = ', '.join(map(os.path.relpath, bags)) or 'nothing'
        message = f'every node was stopped; kept: {kept}'
        raise Interrupted(interrupted.number, message) from None
    return outcomes


def _made(outcomes):
    return [outcome.bag for outcome in outcomes if outcome.bag]
