"""Run controllers through a scenario, record and compare them.

Each run is a bag in DIR/<scenario>/<controller>. With --label NAME it is <controller>@NAME, which
tells variants of one controller apart:

  experiments run SCENARIO --label base
  experiments run SCENARIO --label soft --set controller.safety.obstacle_m=0.3 --beside mpcc@base

A run file has this written down; options win over it (docs/howto/commands.md):

  scenario: double_lane_change     # or a file, relative to this one
  controllers: [mpcc, ./mine.yaml] # may be left out, as all below
  settings: {plant.friction: 0.9}  # as of --set
  labels: [wet]                    # one for all controllers, or one for each
"""

import argparse
from pathlib import Path

from rich.console import Console

from bags.command_line import add_out
from experiments.commands import add_list, add_sensors, add_time_limit

HELP = 'run controllers through a scenario, record and compare them'
EXAMPLE = 'experiments run double_lane_change --controller mpcc --set plant.friction=0.9'
EXIT_CODES = {
    1: 'a car did not reach the finish line on the road, or what the scenario expects is not met'
}
RUNS = Path('bags', 'runs')
TIME_LIMIT_S = 900.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments run`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    text = 'a name, or the path of a YAML file: of a scenario, or a run file'
    parser.add_argument('scenario', metavar='SCENARIO', help=text)
    text = 'a name in mpcc_controller/config, a YAML file, or a program that is a node'
    add_list(parser, '--controller', text, 'mpcc', dest='controllers', metavar='C')
    text = 'a program of yours in place of plant_node: a Python file or an executable '
    text += '(docs/howto/own_plant.md)'
    parser.add_argument('--plant', default='', metavar='PROGRAM', help=text)
    text = 'lockstep: simulated time, as fast as possible, repeatable; realtime: wall clock '
    text += '(default: lockstep)'
    modes = 'lockstep', 'realtime'
    parser.add_argument('--mode', choices=modes, default=modes[0], help=text)
    add_out(parser, RUNS, '<scenario>/<controller>/ and the comparison')
    text = 'set a parameter of the plant, controller, scenario or recorder'
    add_list(parser, '--set', text, dest='settings', metavar='NODE.param=value')
    add_sensors(parser)
    text = 'name of this variant: its runs are called <controller>@NAME'
    parser.add_argument('--label', default='', metavar='NAME', help=text)
    text = 'also compare with an earlier run of the scenario, as mpcc@soft, or a path'
    add_list(parser, '--beside', text, metavar='RUN')
    text = 'replace earlier runs; without it, one that this run does not merely repeat is kept as '
    text += '<run>@1, @2, ...'
    parser.add_argument('--overwrite', action='store_true', help=text)
    text = 'drive also with a car file of the controller that is not that of the plant'
    parser.add_argument('--any-car', action='store_true', help=text)
    text = 'also start markers_node, which draws the run for RViz and Foxglove (/markers, /tf)'
    parser.add_argument('--markers', action='store_true', help=text)
    add_time_limit(parser, '--time-limit', TIME_LIMIT_S, 'a run is stopped')


def run(options: argparse.Namespace) -> int:
    """Run and compare; return 0 when every run was completed. Raises BagError."""
    from experiments.run import run_and_compare

    given = {name: getattr(options, name) for name in run_and_compare.Request._fields}
    return run_and_compare.run(run_and_compare.Request(**given), Console())
