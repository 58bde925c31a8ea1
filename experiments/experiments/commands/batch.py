"""Simulate every combination of scenarios, controllers, settings, draws and runs; a row per drive.

The study is a YAML file (docs/batch.md):

    schema: 1
    scenarios: [double_lane_change, ./roads/*.yaml]  # names, files, patterns of files
    families: [pop_up]                               # of the library, each draw another emergency
    controllers: [mpcc, frenet, ./my_mpcc.yaml]      # names, files
    set:                                             # as of --set; lists of values, full grid
      controller.safety.obstacle_m: [0.5, 0.7]
    draw:                                            # the same names; scrambled Sobol points
      scenario.friction: {uniform: [0.5, 1.0]}       # or log_uniform, choice: [value, ...]
      plant.car.body.mass_kg: {normal: [1800, 100], within: [1500, 2100]}
    draws: 256 # of `draw` and of every family; every controller and setting has the same ones
    runs: 20   # of each; all but the first with another speed (+-0.5 km/h) and grip (+-3 %)
    seed: 1    # run 7 has the same perturbation for every controller, setting and draw

The table is DIR/results.parquet, for pandas, Polars, DuckDB, MATLAB. Finished drives are kept in
DIR/drives.jsonl: the same command continues a batch that was interrupted, and simulates only what
is missing when the study grows. A drive that fails costs its row, which says why; the next call
tries it again.
"""

import argparse
from pathlib import Path

from rich.console import Console

from experiments.commands import add_sensors, add_time_limit, add_workers

HELP = 'simulate scenarios, controllers, settings and random draws; a Parquet table'
EXAMPLE = 'experiments batch experiments/config/batch_example.yaml --out /tmp/batch'
EXIT_CODES = {1: 'drives failed; the same command tries them again'}
LIMIT_S = 300.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments batch`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument('study', type=Path, metavar='STUDY.yaml', help='what is combined')
    text = 'receives table and records'
    parser.add_argument('--out', type=Path, required=True, metavar='DIR', help=text)
    parser.set_defaults(settings=[])
    add_sensors(parser)
    add_workers(parser, 'the table')
    add_time_limit(parser, '--limit-s', LIMIT_S, 'a drive counts as failed')


def run(options: argparse.Namespace) -> int:
    """Run a batch; 0 when no drive failed. Raises BagError."""
    from experiments.batch import run_batch

    return run_batch.run(options, Console())
