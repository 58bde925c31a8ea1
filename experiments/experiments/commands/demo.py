"""Drive what the paper's figures show, then an emergency, and say what became of each car.

The emergency is the entry `cut_in` of the library: of 10 starts each, with another speed
(+-0.5 km/h) and grip (+-3 %), mpcc_road survived all, and mpcc and frenet none.
"""

import argparse

from rich.console import Console

from bags.command_line import add_out, print_text
from bags.errors import BagError
from experiments.commands import paper
from experiments.commands.run import RUNS, TIME_LIMIT_S

HELP = "what the paper's figures show, and an emergency"
EXAMPLE = 'experiments demo'
EXIT_CODES = {1: 'the MPCC of one of the two drives did not survive it'}
EMERGENCY, CONTROLLERS = 'cut_in', ('mpcc_road', 'mpcc', 'frenet')
# each with the controller that is to survive first
DRIVES = {
    "1/2 The paper's picture, not the typical case (docs/results.md): MPCC, without collision "
    'avoidance (no_ca), baseline': (str(paper.PICTURE), ()),
    '2/2 An emergency: a car cuts in 20 m ahead and brakes; mpcc_road, made for emergencies, and '
    "the paper's two": (EMERGENCY, CONTROLLERS),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments demo`."""
    add_out(parser, RUNS, '<scenario>/<controller>/ and the comparisons')


def run(options: argparse.Namespace) -> int:
    """Drive, compare and print; return 0 when both MPCCs survived. Raises BagError."""
    from experiments.configuration import inputs, node_config
    from experiments.run import compile_ahead, run_and_compare, run_file
    from mpcc_controller import car_file

    if not paper.PICTURE.is_file():
        raise BagError(f'{paper.PICTURE}: is not here; `experiments demo` runs in a clone')
    console = Console()
    names = (*run_file.load(str(paper.PICTURE)).controllers, *CONTROLLERS)
    configs = [str(controller.config) for controller in node_config.find_controllers(names)]
    loaded = [(params, car_file.load(params)) for params in map(inputs.controller_params, configs)]
    survived = []
    # also those of the emergency, while the first cars drive
    with compile_ahead.compiling(loaded if compile_ahead.is_worth_while() else ()):
        for title, (driven, controllers) in DRIVES.items():
            print_text(console, title)
            request = run_and_compare.Request(
                driven, controllers, 'lockstep', options.out, (), TIME_LIMIT_S
            )
            folder, outcomes = run_and_compare.run_controllers(request, console, False)
            # imported late: on the first use it is there, since the first cars drove
            from bags.report.comparison import compare_bags, show_comparison

            compared = compare_bags([outcome.bag for outcome in outcomes if outcome.bag], folder)
            show_comparison(compared, console, brief=True)
            survived.append(next(iter(compared.values['runs'].values()))['survived'])
    return 0 if all(survived) else 1
