"""Drive a standard manoeuvre with the plant: a table, its numbers as JSON, a figure.

The figure has the motion over time, and the numbers of several levels (of braking, amplitude or
frequency) over them.

manoeuvre NAME [--car vw_gti.yaml] [--friction F] [--out DIR]
manoeuvre --list

Cars are files in config/, or paths with a folder.
"""

import argparse
import json
import math
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from node_runtime.parameters import ParameterError
from vehicle_plant import manoeuvres, parameters
from vehicle_plant.manoeuvres import Case, Driven, Number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MANOEUVRES = {
    name: kind.about
    for name, kind in manoeuvres.Settings.__annotations__.items()
    if hasattr(kind, 'about')
}
# drawn over time; the side slip is that of the CoG
SIGNALS = {
    'road-wheel angle [deg]': lambda column: np.degrees(column('servos.steer.position')),
    'yaw rate [deg/s]': lambda column: np.degrees(column('planar.r')),
    'lateral acceleration [m/s²]': lambda column: column('acceleration.ay'),
    'side slip [deg]': lambda column: np.degrees(
        np.arctan2(column('planar.vy'), column('planar.vx'))
    ),
    'roll [deg]': lambda column: np.degrees(column('ride.phi')),
    'speed [m/s]': lambda column: column('planar.vx'),
    'deceleration [m/s²]': lambda column: -column('acceleration.ax'),
}
COLUMNS = 3  # of the figure
# a number at one of several levels: its name, the level, and what the level is
LEVEL = re.compile(r'(\w+?)(?:_at)?_([\d.]+)(?:_hz)?$')
LEVELS = {
    'sine_sweep': 'frequency [Hz]',
    'turn_braking': 'deceleration [m/s²]',
    'sine_with_dwell': 'amplitude [of its unit]',
}


def draw(name: str, driven: Driven) -> 'Figure':
    """Return the motion of every run over time, and what was found at each level."""
    # half a second, which the help must not take
    from matplotlib.figure import Figure

    levels: dict[str, list[tuple[float, Number]]] = {}
    for match, number in ((LEVEL.match(key), number) for key, number in driven.numbers.items()):
        if match and name in LEVELS:
            levels.setdefault(match[1], []).append((float(match[2]), number))
    count = len(SIGNALS) + len(levels)
    rows = math.ceil(count / COLUMNS)
    figure = Figure(figsize=(12, 2.4 * rows), layout='constrained')
    panels = figure.subplots(rows, COLUMNS).ravel()
    for axes, (label, signal) in zip(panels, SIGNALS.items()):
        for run, track in zip(driven.runs, driven.tracks):
            t = manoeuvres.times(track) - driven.case.settings.settle_s
            axes.plot(t, signal(track.column), label=run.label)
        axes.set(ylabel=label, xlabel='time since the manoeuvre begins [s]')
    for axes, (key, points) in zip(panels[len(SIGNALS) :], levels.items()):
        axes.plot([level for level, _ in points], [number.value for _, number in points], 'o-')
        axes.set(ylabel=f'{key.replace("_", " ")} [{points[0][1].unit}]', xlabel=LEVELS[name])
    for axes in panels[count:]:
        axes.remove()
    for axes in figure.axes:
        axes.grid()
    panels[0].legend(fontsize='small', ncols=2)
    figure.suptitle(f'{name}, {MANOEUVRES[name]}; friction {driven.case.friction:g}')
    return figure


def record(name: str, friction: float, numbers: dict[str, Number]) -> str:
    """Return the numbers as JSON text; NaN becomes null."""
    values = {
        key: n._asdict() | {'value': n.value if n.value == n.value else None}
        for key, n in numbers.items()
    }
    return json.dumps({'manoeuvre': name, 'friction': friction, 'numbers': values}, indent=2) + '\n'


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser(prog='manoeuvre', description=__doc__.splitlines()[0])
    parser.add_argument('name', nargs='?', choices=MANOEUVRES, metavar='NAME', help='see --list')
    parser.add_argument('--list', action='store_true', help='list the manoeuvres')
    parser.add_argument('--car', help='car file instead of the default car')
    parser.add_argument('--friction', type=float, default=1.0, help='road friction scale')
    parser.add_argument('--out', type=Path, help='folder for NAME.json and NAME.png')
    options = parser.parse_args(arguments)
    if options.list:
        for name, about in MANOEUVRES.items():
            print(f'{name:<18}{about}')
        return 0
    if options.name is None:
        parser.error('which manoeuvre? --list names them')
    if not 0.0 < options.friction <= 2.0:
        parser.error(f'friction is {options.friction}, allowed 0 to 2')
    try:
        plant = parameters.load(parameters.car_file(options.car or parameters.DEFAULT_CAR, '--car'))
        case = Case(plant, options.friction, manoeuvres.load_settings())
        driven = manoeuvres.perform(options.name, case)
    except (ParameterError, FileNotFoundError, ValueError) as error:
        parser.exit(1, f'manoeuvre: {error}\n')
    numbers = driven.numbers
    width, unit = max(map(len, numbers)), max(len(n.unit) for n in numbers.values())
    for name, n in numbers.items():
        print(f'{name:<{width}}  {n.value:12.6g}  {n.unit:<{unit}}  {n.meaning}')
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        path = options.out / options.name
        path.with_suffix('.json').write_text(record(options.name, options.friction, numbers))
        figure = draw(options.name, driven)
        figure.savefig(path.with_suffix('.png'), dpi=100, metadata={'Software': None})
    return 0


if __name__ == '__main__':
    sys.exit(main())
