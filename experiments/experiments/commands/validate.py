"""Say how well the controllers' prediction, and the plant, follow a recorded drive.

From every measured state the prediction model follows the measured steer and speed: errors of
lateral speed, yaw rate and position at 0.25 to 2 s, by lateral acceleration, beside the same car
with linear tyres and beside holding the state. Then the hardest manoeuvre of each log from its
first state on, with the plant, too. A figure and the numbers are written to --out.

The offsets of the log's steer and sideslip are those that `identify` wrote beside the car file.
"""

import argparse
from pathlib import Path

from bags import command_line
from bags.command_line import add_out, print_paths, print_text
from bags.errors import BagError
from experiments.commands.identify import FILE_WIDTH, add_log_arguments

HELP = 'errors of the prediction model and the plant against recorded driving'
EXAMPLE = 'experiments validate sine.vbo --map car.map.yaml --car ./car.yaml --out runs/validation'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments validate`."""
    add_log_arguments(parser)
    text = 'car file of the controllers: a name in mpcc_controller/config, or a path'
    parser.add_argument('--car', required=True, metavar='FILE', help=text)
    text = 'plant file of the same car: a name in vehicle_plant/config, or a path (default: none)'
    parser.add_argument('--plant', metavar='FILE', help=text)
    add_out(parser, Path('runs/validation'), 'figure and numbers')


def run(options: argparse.Namespace) -> int:
    """Compare, show and write; return 0. Raises BagError."""
    from experiments.measured import log_map
    from mpcc_controller import car_file
    from node_runtime import node_parameters
    from vehicle_plant import parameters

    shown = command_line.wide_console(FILE_WIDTH)
    known = log_map.load(options.map)
    car = car_file.read(options.car)
    # a mistake in map or car file is told before scipy, CasADi and matplotlib are loaded
    from experiments.measured import measured_log, report, validation

    path = node_parameters.find_config('mpcc_controller', options.car)
    try:
        fit = report.read_fit(path)
    except (ValueError, TypeError) as error:
        raise BagError(f'{path.with_suffix(".json")}: is not of identify: {error}') from None
    if fit is None:
        name = path.with_suffix('.json').name
        print_text(shown, f'no {name} of identify: steer and sideslip as logged')
    plant = None
    if options.plant:
        plant = parameters.load(parameters.car_file(options.plant, '--plant'))
    logs = [measured_log.load(log, known) for log in options.logs]
    result = validation.validate(logs, car, fit, plant)
    title = f'{path.stem} against {", ".join(log.name for log in logs)}'
    for m in result.manoeuvres:
        print_text(shown, f'\nThrough the manoeuvre of {m.log}')
        shown.print(report.manoeuvre_table(m))
    print_text(shown, '\nErrors ahead of every measured state, rms')
    shown.print(report.error_table(result))
    print_paths(shown, report.write(result, options.out, title))
    return 0
