"""Runs of several controllers through one scenario, and their comparison, with earlier runs too."""

import os
import shlex
import threading
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from bags.command_line import print_text
from bags.errors import BagError
from bags.evaluation.metrics.outcome import stop_station
from bags.storage import read
from experiments import replay
from experiments.configuration import inputs, node_config, run_advice
from experiments.progress import RunProgress
from experiments.run import compile_ahead, domain, node_graph, run_file, staging
from experiments.run.node_graph import RunOutcome, RunSettings
from experiments.run.processes import Interrupt, Interrupted
from msgs_yaml.strict_yaml import closest
from node_runtime import provenance
from scenario_publisher.scenario import Scenario

WARNING = '[yellow]warning, {}:[/] '


class Request(NamedTuple):
    """The arguments of `experiments run`."""

    scenario: str  # a name, or the path of a scenario or run file
    controllers: Sequence[str]  # names in mpcc_controller/config, or paths of files and programs
    mode: str
    out: Path
    settings: Sequence[str]  # NODE.parameter=value
    time_limit_s: float  # of wall time per run
    markers: bool = False  # whether to start the node that draws for 3D viewers
    label: str = ''  # of the runs
    overwrite: bool = False  # whether older runs are replaced rather than kept under a number
    any_car: bool = False  # whether the controller's car may be another one than the plant
    beside: Sequence[str] = ()  # further runs to compare with: names in the folder, or paths
    plant: str = ''  # path of a program that is started in place of plant_node


def run(request: Request, console: Console) -> int:
    """Run the controllers and compare their bags; return 0 when every run was completed.

    A car that crosses the finish line beside the road has not completed the run. Where the scenario
    expects something (`expect:`), that decides instead: 0 when every run meets all of it. Raises
    BagError for a scenario, controller, setting or folder that cannot be used, before any node
    starts, and Interrupted, which names the bags kept, after a signal. No process is left behind in
    any case.
    """
    given, controllers, scn = _read(request)
    if scn.expect:
        # imported late: it loads the metrics
        from experiments import pass_criteria

        pass_criteria.check_names(scn.expect, given.scenario)
    others = find_earlier(request.beside, request.out / scn.name, scn)
    folder, outcomes = run_controllers(request, console)
    bags = _kept_bags(outcomes)
    _show_earlier_runs(outcomes, request.overwrite, console)
    is_well = all(outcome.completed for outcome in outcomes)
    if bags:
        _begin_import().join()
        from bags.report.comparison import compare_bags, show_comparison

        try:
            # other scenarios were refused before the run; other plants are what is compared
            paths = with_new_runs(others, outcomes)
            compared = compare_bags(paths, folder, force=bool(others))
        except Exception as error:
            kept = ' '.join(os.path.relpath(bag) for bag in bags)
            raise BagError(f'the comparison failed: {error}; kept: {kept}') from error
        show_comparison(compared, console)
        for text in describe_other_plants(paths):
            console.print('[yellow]warning:[/] ', end='')
            print_text(console, text)
        # in order, and first; those that they are compared with have had their own exit code
        names = (outcome.controller for outcome in outcomes if outcome.bag)
        runs = dict(zip(names, compared.values['runs'].values()))
        programs = {controller.run_name for controller in controllers if controller.program}
        _explain(outcomes, programs, runs, console)
        if scn.expect:
            # instead of completion: a run that is to end in a stop never completes
            judged = [
                (controller, outcome)
                for controller, metrics in runs.items()
                for outcome in pass_criteria.judge(scn.expect, metrics)
            ]
            console.print(pass_criteria.build_table(judged))
            is_met = all(outcome.is_met for _, outcome in judged)
            return 0 if is_met and len(runs) == len(outcomes) else 1
        is_well = is_well and all(run['completed'] for run in runs.values())
    return 0 if is_well else 1


def _read(request):
    """Return what is driven, of the run file or scenario and the options; controllers; scenario."""
    run = run_file.load(request.scenario)
    given = run_file.with_options(run, request.controllers, request.settings, request.label)
    controllers = node_config.find_controllers(given.controllers, given.labels, programs=True)
    return given, controllers, inputs.load_scenario(given.scenario)


def _show_earlier_runs(outcomes, overwrites, console):
    """Say what became of the runs that were where the new ones are."""
    for outcome in outcomes:
        if outcome.older:
            what = f'the run that was there is kept as {os.path.relpath(outcome.older)}'
        elif outcome.has_replaced:
            why = '--overwrite' if overwrites else 'of the same scenario, code and parameters'
            what = f'replaces the run that was there ({why}); --label NAME keeps both'
        else:
            continue
        print_text(console, f'{outcome.controller}: {what}')


def _explain(outcomes, programs, runs, console):
    """Say why the exit code is 1 for a run that the plant completed, and what shows a loss."""
    lost = []
    for outcome in outcomes:
        name, run = outcome.controller, runs.get(outcome.controller)
        if run and outcome.completed and not run['completed']:
            why = f'although the plant reports "{outcome.message}": {run["verdict"]}'
            print_text(console, f'{name}: not completed, {why}; the exit code is 1')
        # a program of the user has no problem that could be solved again
        if not run or not outcome.bag or name in programs:
            continue
        if run['collided'] or run['left_road'] or run['lost']:
            bag = shlex.quote(os.path.relpath(outcome.bag))
            when = f'what it planned {replay.LEAD_S:g} s before it was lost'
            lost.append(f'{name}: {when}: experiments resolve {bag} --at {replay.LOSS}')
    for text in lost:
        print_text(console, text)


@cache
def _begin_import() -> threading.Thread:
    """Begin to import figures and report, which takes a second, beside what else is done.

    Not at the start of the program: an error in the input must not wait for them.
    """
    thread = threading.Thread(target=import_module, args=('bags.report.comparison',))
    thread.start()
    return thread


def run_controllers(
    request: Request, console: Console, compiles: bool = True
) -> tuple[Path, list[RunOutcome]]:
    """Run the controllers as `run`; return the folder of the scenario and outcomes.

    `compiles` is whether to compile ahead: not where the caller does it.
    """
    given, controllers, scn = _read(request)
    folder = request.out / scn.name
    settings = RunSettings(
        scn,
        request.mode,
        folder.absolute(),
        request.time_limit_s,
        markers=request.markers,
        overwrite=request.overwrite,
    )
    plant = node_config.find_plant(request.plant) if request.plant else ()
    # the checks compile something. On the wall clock the nodes need all cores
    compiles_ahead = compiles and request.mode == 'lockstep' and compile_ahead.is_worth_while()
    checked = {}
    for controller in controllers:
        own = given.scenario, controller, given.settings, given.origins, request.mode
        nodes = inputs.build_nodes(scn, *own, plant_program=plant)
        own_parameters = inputs.check_parameters(nodes)
        if not (request.any_car or controller.program or plant):
            inputs.check_car_fits(nodes, own_parameters)
        if not controller.program:
            inputs.check_problem(own_parameters, controller.name)
        checked[controller] = nodes, own_parameters
    own = [checked[c][1][inputs.CONTROLLER] for c in controllers if not c.program]
    with compile_ahead.compiling(own if compiles_ahead else ()):
        runs = []
        for controller, (nodes, own_parameters) in checked.items():
            facts = inputs.loaded_facts(own_parameters, is_shipped_plant=not plant)
            runs.append((controller, nodes, facts))
            warnings = run_advice.find_warnings(scn, given.scenario, own_parameters)
            if request.any_car and not (controller.program or plant):
                warnings = [*inputs.describe_misfit(nodes, own_parameters), *warnings]
            for text in warnings:
                console.print(WARNING.format(controller.run_name), end='')
                print_text(console, text)
        with staging.created_folder(folder, f'--out {request.out}'):
            return folder, _run_each(settings, runs, console)


def _run_each(settings, runs, console):
    """Run each controller with its nodes and what is recorded of them."""
    for line in staging.recover(settings.folder):
        print_text(console, line)
    others = domain.describe_others(os.environ)
    if others:
        print_text(console, f'warning: {others}', 'yellow')
    stop, outcomes = settings.scn.stop, []
    length_m = stop_station(settings.path, (stop.X, stop.Y), stop.armed_after)
    # on the wall clock the nodes need all cores
    on_motion = _begin_import if settings.mode == 'lockstep' else None
    try:
        with (
            Interrupt() as interrupt,
            RunProgress(console, on_motion) as progress,
            domain.reserved(os.environ) as domain_id,
        ):
            settings = settings._replace(domain=domain_id)
            for run in runs:
                progress.begin(run[0].run_name, length_m)
                outcome = node_graph.run_once(settings, *run, interrupt, progress)
                progress.end(outcome.controller, outcome.completed, outcome.message)
                outcomes.append(outcome)
    except Interrupted as interrupted:
        bags = _kept_bags(outcomes) + [bag for bag in (interrupted.kept,) if bag]
        kept = ', '.join(map(os.path.relpath, bags)) or 'nothing'
        message = f'every node was stopped; kept: {kept}'
        raise Interrupted(interrupted.number, message) from None
    return outcomes


def _kept_bags(outcomes):
    return [outcome.bag for outcome in outcomes if outcome.bag]


def find_earlier(names: Sequence[str], folder: Path, scn: Scenario) -> list[Path]:
    """Return the folders of the named runs; a name without a separator is in `folder`.

    Raises BagError for one that does not exist, is no bag, or drove another scenario.
    """
    paths = []
    for name in names:
        path = Path(os.path.expanduser(name)) if os.sep in name else folder / name
        if not path.exists():
            runs = sorted(bag.parent.name for bag in folder.glob('*/metadata.yaml'))
            there = f'; there are {", ".join(runs)}' if runs else '; there is none yet'
            raise BagError(
                f'--beside {name}: no run {os.path.relpath(path)}{there}{closest(name, runs)}'
            )
        info = read.run_info(path)
        if info.get('scenario_sha256') != provenance.digest(scn.text):
            what = info.get('scenario', 'an unknown one')
            same = what == scn.name
            which = f'another version of {what}' if same else f'another scenario, {what}'
            raise BagError(
                f'--beside {name}: {os.path.relpath(path)} drove {which}; drive its controller in '
                'this one too (a second --controller)'
            )
        paths.append(path)
    return paths


def describe_other_plants(paths: Sequence[Path]) -> list[str]:
    """Return a line for each run that drove another plant than the first, and what differs."""
    # imported late: pages and figures take a second to load
    from bags.report.comparability import describe_plants

    first, *others = paths
    reference = read.run_info(first)
    differing = {path: describe_plants(reference, read.run_info(path)) for path in others}
    return [
        f'{path.name} drove another plant than {first.name}: {what}; what differs between them is '
        f'not of the controllers alone. To compare controllers, drive {path.name} once more with '
        'the plant of the others (the same --set plant. options; for another car also its '
        '--set controller.car_file, or --any-car) and a --label of its own'
        for path, what in differing.items()
        if what
    ]


def with_new_runs(others: Sequence[Path], outcomes: Sequence[RunOutcome]) -> list[Path]:
    """Return the folders of new runs and of those to compare with, which may have got a number.

    One that a new run repeated is that run.
    """
    new = {os.path.abspath(outcome.bag): outcome for outcome in outcomes if outcome.bag}
    paths = [outcome.bag for outcome in new.values()]
    for other in others:
        replaced = new.get(os.path.abspath(other))
        place = replaced.older if replaced else other
        if place and place not in paths:
            paths.append(place)
    return paths
