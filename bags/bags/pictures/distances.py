"""The command `bags distances`: the paper's first experiment, from one recorded drive on a circle.

It says how far the distance to the obstacle differs between path coordinates and the ground: by
closed form on the circle of the bag, and at the poses that were driven.
"""

import json
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from bags.pictures import distance_figure
from bags.storage import read
from bags.verdict import recorded, two_frames
from bags.verdict.drive import Drive
from bags.verdict.two_frames import Circle, Recorded

FILE = 'distances.json'
GAPS_M = (2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0)  # along the path, those of the table
WIDER = (1.0, 2.0, 5.0, 10.0)  # radii of the table, in those of the circle
CLOSE = 1e-4  # relative; a gap next to the obstacle, and squared the precision of a bisection


class Found(NamedTuple):
    """What came out, and where it was written."""

    values: dict[str, Any]  # distances.json
    file: Path
    figures: list[Path]


def bag(path: Path | str, out: Path) -> Found:
    """Write the figure and its numbers for the bag at `path` into the folder `out`.

    Raises BagError for a bag that cannot be judged or whose path is no circle with one obstacle.
    """
    return write(recorded.of_bag(read.load(path)), out)


def write(drive: Drive, out: Path) -> Found:
    """Write the figure and its numbers for a drive."""
    circle = two_frames.circle_of(drive)
    driven = two_frames.recorded(drive, circle)
    values = numbers(drive, circle, driven)
    out.mkdir(parents=True, exist_ok=True)
    file = out / FILE
    file.write_text(json.dumps(values, indent=2, allow_nan=False) + '\n')
    return Found(values, file, distance_figure.write(drive, circle, driven, out))


def numbers(drive: Drive, circle: Circle, driven: Recorded) -> dict[str, Any]:
    """Return everything that the figure shows, in metres."""
    sides = {'inside': abs(circle.inside), 'outside': -abs(circle.inside)}
    return {
        'scenario': drive.facts.scenario,
        'controller': drive.facts.controller,
        'radius_m': circle.radius,
        'obstacle_at_m': circle.station,
        'obstacle_inside_m': circle.inside,
        'radii_together_m': circle.reach,
        'gaps_m': list(GAPS_M),
        'overestimation_m': {
            side: _over(circle, circle.radius, inside) for side, inside in sides.items()
        },
        'outside_turns_at_m': turning_gap(circle.radius, sides['outside']),
        'over_curvature': [
            {'curvature_1pm': 1 / (by * circle.radius)}
            | {side: _over(circle, by * circle.radius, n) for side, n in sides.items()}
            for by in WIDER
        ],
        'recorded': _of_drive(circle, driven),
    }


def _over(circle, radius, inside):
    found = two_frames.on_circle(radius, np.array(GAPS_M), inside, circle.reach)
    return found.overestimation.tolist()


def turning_gap(radius: float, inside: float) -> float:
    """Return the gap [m] up to which path coordinates underestimate the distance to an obstacle.

    0 for one inside the circle: there they overestimate it at every gap.
    """

    def over(gap):
        return two_frames.on_circle(radius, gap, inside, 0.0).overestimation

    low, high = 0.0, np.pi * radius
    if over(high * CLOSE) >= 0:
        return 0.0
    while high - low > high * CLOSE**2:
        middle = (low + high) / 2
        low, high = (low, middle) if over(middle) > 0 else (middle, high)
    return float(high)


def _of_drive(circle, driven):
    """Return the least distances, and the same table where the drive came that close."""
    coming = driven.station <= circle.station
    gaps = circle.station - driven.station[coming]

    def at(distances):
        return np.interp(GAPS_M, gaps[::-1], distances.overestimation[coming][::-1]).tolist()

    return {
        'min_v2o_m': float(driven.distances.cartesian.min()),
        'min_v2o_frenet_m': float(driven.distances.frenet.min()),
        'collided': bool(driven.distances.cartesian.min() < 0),
        'largest_offset_from_path_m': float(np.abs(driven.inside).max()),
        'largest_deviation_from_closed_form_m': _deviation(circle, driven),
        'overestimation_m': {
            'inside' if circle.inside > 0 else 'outside': at(driven.distances),
            'outside' if circle.inside > 0 else 'inside': at(driven.beyond),
        },
    }


def _deviation(circle, driven):
    """Return how far the distances at the driven poses are from the closed form for them [m]."""
    gap = driven.station - circle.station
    worst = 0.0
    for own, inside in ((driven.distances, circle.inside), (driven.beyond, -circle.inside)):
        closed = two_frames.on_circle(circle.radius, gap, inside, circle.reach, driven.inside)
        apart = np.abs(np.subtract(own, closed))
        worst = max(worst, float(apart.max()))
    return worst


def show(found: Found, console: Console) -> None:
    """Print the table, and where the files are."""
    values = found.values
    title = f'Frenet less Cartesian distance, in metres, on a radius of {values["radius_m"]:.0f} m'
    table = Table(title=title, title_justify='left')
    table.add_column('m along the path', no_wrap=True)
    rows = [('closed form', values), ('recorded poses', values['recorded'])]
    columns = [
        (f'{side}, {name}', of['overestimation_m'][side])
        for side in ('inside', 'outside')
        for name, of in rows
    ]
    for name, _ in columns:
        table.add_column(name, justify='right')
    for i, gap in enumerate(values['gaps_m']):
        table.add_row(f'{gap:.0f}', *(f'{column[i]:+.2f}' for _, column in columns))
    console.print(table)
    for label, path in (('numbers', found.file), ('figure', found.figures[0])):
        console.print(f'{label}: {os.path.relpath(path)}', markup=False, highlight=False)
