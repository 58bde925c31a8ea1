"""Curves from a CSV file beside those of the runs: measured elsewhere, or read off a publication.

The first row names the columns, in any order:

    time_s, station_m   since the first state of the runs, along the coarse path
    x_m, y_m            in the frame map; they also give the station where it is missing
    any column of SIGNALS

At least one of time_s, station_m, or both x_m and y_m; and anything to draw. An empty cell is a
gap, but for x_m and y_m; lines that begin with # are comments.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bags.errors import BagError
from bags.evaluation import geometry
from bags.evaluation.drive import Scene
from bags.figures import style
from msgs_yaml.strict_yaml import closest

TIME, STATION, X, Y = AXES = ('time_s', 'station_m', 'x_m', 'y_m')
DEGREES = math.degrees(1.0)
KILO = 1e-3


# by column: the panel where it is drawn, and the factor to its unit
SIGNALS: Mapping[str, tuple[str, float]] = {
    'v2o_m': ('v2o', 1.0),
    'v2e_left_m': ('v2e_left', 1.0),
    'v2e_right_m': ('v2e_right', 1.0),
    'contouring_m': ('contouring', 1.0),
    'vx_mps': ('velocity', 1.0),
    'sideslip_rad': ('sideslip', DEGREES),
    'sideslip_deg': ('sideslip', 1.0),
    'ax_mps2': ('gg_x', 1.0),
    'ay_mps2': ('lateral', 1.0),
    'steer_rad': ('steer', DEGREES),
    'steer_deg': ('steer', 1.0),
    'force_x_n': ('force', KILO),
    'force_x_kn': ('force', 1.0),
    'friction_front': ('friction_front', 1.0),
    'friction_rear': ('friction_rear', 1.0),
    'solve_ms': ('solve', 1.0),
}


class Overlay(NamedTuple):
    """The columns of a file, each (n,), not-a-number where a cell is empty."""

    name: str  # of the file, without its ending
    look: style.Look
    axes: Mapping[str, np.ndarray]  # by name in AXES, those that are known
    signals: Mapping[str, np.ndarray]  # by panel, in its unit

    def path(self) -> np.ndarray | None:
        """Return the positions (n, 2) [m]; None where they are unknown."""
        if X in self.axes and Y in self.axes:
            return np.column_stack([self.axes[X], self.axes[Y]])
        return None


def read_overlays(files: Sequence[Path], runs: Sequence[str], scene: Scene) -> list[Overlay]:
    """Return the overlays in CSV files, with colours that the runs do not have.

    The scene gives stations to positions. Raises BagError, which names file and line.
    """
    names = [Path(file).stem for file in files]
    for k, (file, name) in enumerate(zip(files, names)):
        if name in runs or name in names[:k]:
            raise BagError(f'{file}: something else is called {name!r}; give the file another name')
    colours = style.assign_colours([*runs, *names])
    return [
        _overlay(Path(file), style.Look(colours[name], style.DOTTED, style.WIDTHS[1] + 0.6), scene)
        for file, name in zip(files, names)
    ]


def _overlay(file, look, scene):
    columns = _read(file)
    axes = {name: columns[name] for name in AXES if name in columns}
    signals = {}
    for name in [name for name in columns if name not in axes]:
        signal, factor = SIGNALS[name]
        if signal in signals:
            raise BagError(f'{file}: two columns of {signal}, one of them {name}')
        signals[signal] = columns[name] * factor
    if X in axes and Y in axes:
        points = np.column_stack([axes[X], axes[Y]])
        if not np.isfinite(points).all():
            raise BagError(f'{file}: x_m and y_m must have a number in every row')
        along = geometry.project_drive(points, scene.reference, np.inf)
        axes.setdefault(STATION, along.distance)
        signals.setdefault('contouring', along.offset)
    if TIME not in axes and STATION not in axes:
        raise BagError(
            f'{file}: needs time_s, station_m, or x_m and y_m; it has {", ".join(columns)}'
        )
    if not signals:
        allowed = ', '.join(SIGNALS)
        raise BagError(f'{file}: nothing to draw; besides {", ".join(AXES)} there may be {allowed}')
    return Overlay(file.stem, look, axes, signals)


def _read(file) -> dict[str, np.ndarray]:
    try:
        text = file.read_text(encoding='utf-8-sig')
    except (OSError, UnicodeDecodeError) as error:
        raise BagError(f'{file}: cannot be read as CSV: {error}') from None
    reader = csv.reader(text.splitlines())
    # neither empty nor a comment
    rows = [
        (reader.line_num, [cell.strip() for cell in row])
        for row in reader
        if any(cell.strip() for cell in row) and not row[0].lstrip().startswith('#')
    ]
    if not rows:
        raise BagError(f'{file}: is empty; the first row must name the columns')
    (_, names), *rows = rows
    known = (*AXES, *SIGNALS)
    for k, name in enumerate(names):
        if name not in known:
            near = closest(name, known)
            raise BagError(
                f'{file}: no column {name!r} is known{near}; allowed are {", ".join(known)}'
            )
        if name in names[:k]:
            raise BagError(f'{file}: two columns are called {name}')
    if not rows:
        raise BagError(f'{file}: has no row below the names of its columns')
    values = np.full((len(rows), len(names)), math.nan)
    for (line, row), numbers in zip(rows, values):
        if len(row) != len(names):
            raise BagError(f'{file}: line {line} has {len(row)} cells, the first row {len(names)}')
        for k, (name, cell) in enumerate(zip(names, row)):
            try:
                numbers[k] = float(cell) if cell else math.nan
            except ValueError:
                raise BagError(
                    f'{file}: line {line}: {name} is {cell!r}, which is no number'
                ) from None
            if math.isinf(numbers[k]):
                raise BagError(f'{file}: line {line}: {name} is not finite')
    return dict(zip(names, values.T))
