"""Look at a scenario before it is driven: what it holds, what is checked, warnings, a picture."""

import argparse
from pathlib import Path

from rich.console import Console

HELP = 'what a scenario holds, what is checked, and a picture of it'
EXAMPLE = 'experiments scenario double_lane_change --plot /tmp/scenario.png'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments scenario`."""
    parser.add_argument('scenario', metavar='SCENARIO', help='a name, or the path of a YAML file')
    parser.add_argument('--plot', type=Path, metavar='OUT', help='PNG, SVG or PDF to draw')
    text = 'whose horizon, distances and limits count: a name, or a file (default: mpcc)'
    parser.add_argument('--controller', default='mpcc', metavar='C', help=text)


def run(options: argparse.Namespace) -> int:
    """Show and draw; return 0, also with warnings. Raises BagError."""
    from bags.command_line import print_paths
    from bags.errors import BagError
    from experiments import preview
    from experiments.configuration import inputs, node_config, run_advice
    from scenario_publisher import scenario

    if options.plot and options.plot.suffix not in ('.png', '.svg', '.pdf'):
        raise BagError(f'--plot {options.plot}: must end in .png, .svg or .pdf')
    controller, console = node_config.find_controller(options.controller), Console()
    try:
        scn = scenario.load(options.scenario)
    except scenario.ScenarioError as error:
        if error.check:
            preview.show_refusals(error.check, console)
        raise
    checked = inputs.check_parameters(inputs.build_nodes(scn, options.scenario, controller))
    params, _ = checked[inputs.CONTROLLER]
    preview.show(scn, params, console)
    preview.show_refusals('', console)
    preview.show_advice(run_advice.judge(scn, options.scenario, checked), console)
    if options.plot:
        print_paths(console, {'\npicture': preview.draw(scn, params, options.plot)})
    return 0
