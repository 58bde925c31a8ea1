"""Simulate every combination of scenarios, controllers, settings and runs; one row per drive.

The study is a YAML file (docs/batch.md):

    schema: 1
    scenarios: [double_lane_change, ./roads/*.yaml]  # names, files, patterns of files
    controllers: [mpcc, frenet, ./my_mpcc.yaml]      # names, files
    set:                                             # as of --set; lists of values, full grid
      plant.friction: [0.8, 0.9, 1.0]
      controller.safety.obstacle_m: [0.5, 0.7]
      scenario.speed_mps: [18.0, 20.8]
    runs: 20   # of each; all but the first with another speed (+-0.5 km/h) and grip (+-3 %)
    seed: 1    # run 7 has the same perturbation for every controller and setting

The table is DIR/results.parquet, for pandas, Polars, DuckDB, MATLAB. Finished drives are kept in
DIR/drives.jsonl: the same command continues a batch that was interrupted, and simulates only what
is missing when the study grows. A drive that fails costs its row, which says why; the next call
tries it again.
"""

import argparse
from pathlib import Path

from rich.console import Console

from experiments.commands import add_jobs, add_time_limit

HELP = 'simulate a grid of scenarios, controllers and settings; a Parquet table'
EXAMPLE = 'experiments batch experiments/config/batch_example.yaml --out /tmp/batch'
LIMIT_S = 300.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments batch`."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument('study', type=Path, metavar='STUDY.yaml', help='what is combined')
    parser.add_argument(
        '--out', type=Path, required=True, metavar='DIR', help='receives table and records'
    )
    add_jobs(parser, 'the table')
    add_time_limit(parser, '--limit-s', LIMIT_S, 'a drive counts as failed')


def run(options: argparse.Namespace) -> int:
    """Run a batch; 0 when no drive failed. Raises BagError."""
    # imported late: simulation and controllers take a second to load
    from experiments.batch import run_batch

    request = run_batch.Request(options.study, options.out, options.jobs, options.limit_s)
    return run_batch.run(request, Console())
