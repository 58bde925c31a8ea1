"""Several controllers through one scenario, one after the other, and the comparison of them."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from bags import closed_loop
from bags.experiments import domain, experiment, folders, run
from bags.experiments.interrupt import Interrupt
from bags.experiments.progress import Progress
from bags.verdict import compare
from msgs_yaml import compiled

NO_COMPILER = (
    '[yellow]no C compiler found:[/] plant and controller run interpreted, several times slower; '
    'what they compute stays the same. On Debian and Ubuntu: apt install gcc'
)


class Plan(NamedTuple):
    """What `bags run` is asked for."""

    scenario: str  # a name, or the path of a file
    controllers: Sequence[str]  # names in mpcc_controller/config, or paths
    mode: str
    out: Path
    settings: Sequence[str]  # NODE.parameter=value
    time_limit_s: float  # of wall time per run
    markers: bool = False  # whether a node draws the ring for 3D viewers


def run_all(plan: Plan, console: Console) -> int:
    """Make the runs, compare those that left a bag; return 0 when every run completed.

    Raises BagError for a scenario, controller or setting that cannot be used, before anything is
    started, and KeyboardInterrupt, which says what was kept, when a signal came; no process is
    left behind in any case.
    """
    folder, outcomes = run_nodes(plan, console)
    made = _made(outcomes)
    if made:
        compare.show(compare.bags(made, folder), console)
    return 0 if all(outcome.completed for outcome in outcomes) else 1


def run_nodes(plan: Plan, console: Console) -> tuple[Path, list[run.Outcome]]:
    """Make the runs as `run_all` does; return the folder of the scenario and how each ended."""
    facts = closed_loop.scenario_facts(plan.scenario)
    chosen = experiment.controllers(plan.controllers)
    overrides = experiment.overrides(plan.settings)
    folder = plan.out / facts.name
    for controller in chosen:
        ring = experiment.nodes(facts, controller, plan.mode, folder, folder, overrides)
        closed_loop.check_parameters(ring)
    for line in folders.recover(folder):
        console.print(line, markup=False, highlight=False, soft_wrap=True)
    if compiled.find_compiler() is None:
        console.print(NO_COMPILER)
    outcomes = []
    try:
        with (
            Interrupt() as interrupt,
            Progress(console) as progress,
            domain.reserved(os.environ) as number,
        ):
            settings = run.Settings(
                plan.mode,
                folder.absolute(),
                overrides,
                number,
                plan.time_limit_s,
                plan.markers,
            )
            for controller in chosen:
                progress.begin(controller.name, facts.length_m)
                outcome = run.one(facts, controller, settings, interrupt, progress)
                progress.end(outcome.controller, outcome.completed, outcome.message)
                outcomes.append(outcome)
    except KeyboardInterrupt:
        kept = ', '.join(os.path.relpath(bag) for bag in _made(outcomes)) or 'nothing'
        raise KeyboardInterrupt(f'every node was stopped; kept: {kept}') from None
    return folder, outcomes


def _made(outcomes):
    return [outcome.bag for outcome in outcomes if outcome.bag]
