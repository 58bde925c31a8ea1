"""List what can be set: every parameter with its default, range, unit and meaning."""

import argparse

from rich.console import Console

HELP = 'what can be set, with default, range, unit and meaning'
EXAMPLE = 'experiments parameters contouring --controller mpcc_road'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments parameters`."""
    text = 'words that the name or meaning must have, as `friction` (default: everything)'
    parser.add_argument('words', nargs='*', metavar='WORD', help=text)
    text = 'whose values are the defaults: a name, or a YAML file (default: mpcc)'
    parser.add_argument('--controller', default='mpcc', metavar='C', help=text)
    parser.add_argument('--json', action='store_true', help='print everything as a JSON list')


def run(options: argparse.Namespace) -> int:
    """List. Raises BagError for words that no parameter has."""
    from experiments.configuration import parameter_list

    sections = parameter_list.search(parameter_list.sections(options.controller), options.words)
    if options.json:
        print(parameter_list.as_json(sections))
    else:
        parameter_list.show(sections, Console())
    return 0
