"""Compare the distance to an obstacle on a circle in two frames: the paper's first experiment."""

import argparse
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from bags import command_line

HELP = 'distance to the obstacle on a circle, in two frames (experiment 1)'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `bags distances`."""
    command_line.add_bag(parser, type=Path, help='a run of circle_20m')
    command_line.add_out(parser, 'the folder of the bag', 'distances.json, .png and .svg')


def run(args: argparse.Namespace) -> int:
    """Compute the distances and show them. Raises BagError."""
    from bags import run as run_of
    from bags.figures import frame_distances

    out = args.out or Path(os.path.abspath(args.bag)).parent
    drive = run_of.load(args.bag).drive
    show(*frame_distances.write_frame_distances(drive, out), Console())
    return 0


def show(values: Mapping[str, Any], paths: Mapping[str, Path], console: Console) -> None:
    """Print the table of `frame_distances.write_frame_distances` and where its files are."""
    title = f'Frenet less Cartesian distance, in metres, on a radius of {values["radius_m"]:.0f} m'
    columns = {
        f'{side}, {name}': numbers['overestimation_m'][side]
        for side in ('inside', 'outside')
        for name, numbers in (('closed form', values), ('recorded poses', values['recorded']))
    }
    rows = [
        (f'{gap:.0f}', *(f'{value:+.2f}' for value in over))
        for gap, *over in zip(values['gaps_m'], *columns.values())
    ]
    console.print(title)
    console.print(command_line.table(['m along the path', *columns], rows))
    command_line.print_paths(console, paths)
