"""Identify the controllers' car from recorded driving: VBO, MATLAB, CSV or a bag.

The map says which column is which signal, in which unit, and what is known of the car: masses and
lengths, which no log tells. Stiffness and peak friction of both axles, the place of the CoG within
0.1 m (where the log tells it), offset and delay of the steer and the offset of the sideslip are
fitted to windows of 2 s: the prediction model with the measured speed and steer against measured
lateral speed and yaw rate. Prints every parameter with its interval of 95 %, which of them the log
does not tell, and how well the car predicts these logs, and those held out. OUT is the car file;
beside it are a figure of the latter (.png) and the numbers for `experiments validate` (.json).
"""

import argparse
from pathlib import Path

from bags import command_line
from bags.command_line import print_text
from bags.errors import BagError
from experiments.commands import add_list
from msgs_yaml.strict_yaml import Leaf, Range, closest

HELP = "the controllers' car from recorded driving, with intervals"
EXAMPLE = (
    'experiments identify step.vbo slalom.vbo --held-out sine.vbo --map car.map.yaml --out car.yaml'
)

FILE_WIDTH = 160
AHEAD_S = 1.0  # of the errors that are shown; `validate` shows more


def add_log_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the logs and their map."""
    parser.add_argument('logs', type=Path, nargs='+', metavar='LOG', help='.vbo, .mat, .csv or bag')
    text = 'YAML file: columns of the logs, and what is known of the car (docs/real_cars.md)'
    parser.add_argument('--map', type=Path, required=True, metavar='FILE', help=text)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments identify`."""
    add_log_arguments(parser)
    parser.add_argument('--out', type=Path, required=True, metavar='OUT', help='car file to write')
    text = 'a log that is not fitted, only judged'
    add_list(parser, '--held-out', text, type=Path, metavar='LOG')
    text = 'a parameter that is not fitted, as cog_to_front_m=0 (there: away from the map) '
    add_list(parser, '--fix', text, metavar='NAME=VALUE')
    text = 'fitted besides: how far the front wheels give way to their lateral force'
    add_list(parser, '--add', text, choices=('compliance',))


def run(options: argparse.Namespace) -> int:
    """Fit and write; return 0. Raises BagError."""
    from experiments.measured import log_map

    shown = command_line.wide_console(FILE_WIDTH)
    known = log_map.load(options.map)
    # a mistake in the map is told before scipy, CasADi and matplotlib are loaded
    from experiments.measured import measured_log, report, single_track_fit, validation

    logs = [measured_log.load(path, known) for path in options.logs]
    held_out = [measured_log.load(path, known) for path in options.held_out]
    for log in (*logs, *held_out):
        for note in log.notes:
            print_text(shown, f'{log.name}: {note}')
    fixed = dict(_parse(text, single_track_fit.KINDS) for text in options.fix)
    fit = single_track_fit.fit(logs, known.car, fixed, bool(options.add))
    if 'cog_to_front_m' in fit.vague:
        print_text(shown, 'the place of the CoG is not told: it stays where the map has it')
        fixed['cog_to_front_m'] = 0.0
        fit = single_track_fit.fit(logs, known.car, fixed, bool(options.add))
    report.write_car(options.out, known.car, fit, [log.name for log in logs])
    shown.print(report.parameter_table(fit))
    first, second, value = fit.correlated
    print_text(shown, f'\nhardest to tell apart: {first} and {second}, correlation {value:.2f}')
    car, picture = report.fitted_car(known.car, fit), options.out.with_suffix('.png')
    for title, judged in (('fitted', logs), ('held out', held_out)):
        if judged:
            result = validation.validate(judged, car, fit, None)
            title = f'{title}: {", ".join(log.name for log in judged)}'
            print_text(shown, f'\n{title}')
            shown.print(report.error_table(result, (AHEAD_S,)))
            report.draw(result, title, picture)
    print_text(shown, f'\ncar file: {options.out}\nfigure: {picture}')
    return 0


def _parse(text, kinds):
    from experiments.configuration.set_option import parse_value

    name, _, value = text.partition('=')
    if name not in kinds:
        raise BagError(f'--fix {text}: unknown parameter{closest(name, kinds)}')
    kind, number = kinds[name], parse_value(text, value, '--fix ')
    fault = Leaf(float, False, Range(kind.low, kind.high, kind.unit)).fault(number)
    if fault:
        raise BagError(f'--fix {text}: {fault}')
    return name, float(number)
