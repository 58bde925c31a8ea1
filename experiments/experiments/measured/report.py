"""What a fit leaves: a car file, numbers, a table; and a validation: tables, a figure, numbers."""

import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import numpy as np
from rich.table import Table

from bags.command_line import table
from bags.figures import style
from experiments.measured import validation
from experiments.measured.measured_log import STEP_S
from experiments.measured.single_track_fit import KINDS, SIGNALS, Fit
from experiments.measured.validation import Manoeuvre, Validation
from mpcc_controller.parameters import CarParams
from node_runtime import parameters

ERRORS = {name: SIGNALS[name] for name in ('vy', 'r')} | {'position': ('position [m]', 1.0)}
COLOURS = {
    validation.PREDICTION: style.KNOWN['mpcc'],
    validation.LINEAR: style.OTHERS[0],
    validation.HOLD: style.QUIET,
    validation.PLANT: style.KNOWN['frenet'],
}


def fitted_car(car: CarParams, fit: Fit) -> CarParams:
    """Return the car with the tyres and the CoG of a fit."""
    body, moved = car.car, fit.values['cog_to_front_m']
    front, rear = body.cog_to_front_m + moved, body.cog_to_rear_m - moved
    body = replace(body, cog_to_front_m=front, cog_to_rear_m=rear)
    tyre = {name: fit.values.get(name) for name in type(car.tyre).__dataclass_fields__}
    return replace(car, car=body, tyre=replace(car.tyre, **tyre))


def parameter_table(fit: Fit) -> Table:
    """Return the parameters with their intervals."""
    rows = []
    for name, value in fit.values.items():
        half = f'± {fit.half_widths[name]:.2g}' if name in fit.half_widths else 'fixed'
        note = ' [bold](the log does not tell)[/]' if name in fit.vague else ''
        rows.append((name, f'{value:.5g}', half, KINDS[name].unit, KINDS[name].meaning + note))
    columns = ('parameter', 'value', '95 %', 'unit', 'meaning')
    return table(columns, rows, left=('parameter', 'unit', 'meaning'))


def write_car(path: Path, car: CarParams, fit: Fit, logs: Sequence[str]) -> None:
    """Write the car file, and beside it what `validate` needs to know of the fit as JSON."""
    lines = [f'# From {", ".join(logs)}; made by', '#   identify --log']
    for name, half in fit.half_widths.items():
        note = ': not told by the log' if name in fit.vague else ''
        unit = KINDS[name].unit
        lines.append(f'# {name}: {fit.values[name]:.5g} +- {half:.2g} {unit} (95 %){note}')
    lines += ['/**:', '  ros__parameters:']
    leaves = parameters.leaves(CarParams)
    for group, members in asdict(fitted_car(car, fit)).items():
        lines.append(f'    {group}:')
        for name, value in members.items():
            if value is not None:
                unit = leaves[f'{group}.{name}'].rule.unit
                lines.append(f'      {name}: {float(f"{value:.6g}")!r}  # {unit}')
    path.write_text('\n'.join(lines) + '\n')
    path.with_suffix('.json').write_text(json.dumps(fit._asdict(), indent=1) + '\n')


def read_fit(path: Path) -> Fit | None:
    """Return the fit that was written beside a car file, None where there is none."""
    file = path.with_suffix('.json')
    if not file.is_file():
        return None
    return Fit(**json.loads(file.read_text()))


def manoeuvre_table(manoeuvre: Manoeuvre) -> Table:
    """Return how every model goes through a manoeuvre as a table."""
    columns = ['model', 'signal', 'rms / range']
    rows = []
    for word in ('greatest', 'least'):
        columns += [word, 'error', 'late [ms]']
    for model, n in manoeuvre.numbers.items():
        for name, (label, factor) in SIGNALS.items():
            row = [model, label, f'{n[f"{name}_rms_of_range"]:.1%}']
            for word in ('greatest', 'least'):
                error, late = n[f'{name}_{word}_error'] * factor, n[f'{name}_{word}_late_s'] * 1000
                row += [f'{n[f"{name}_{word}"] * factor:.3g}', f'{error:+.2g}', f'{late:+.0f}']
            rows.append(row)
    return table(columns, rows, left=('model', 'signal'))


def error_table(result: Validation, ahead_s: Sequence[float] = validation.HORIZONS_S) -> Table:
    """Return the errors ahead of every measured state as a table."""
    columns = ['model', '|ay| [m/s²]', 'ahead [s]', 'starts']
    columns += [label for label, _ in ERRORS.values()]
    rows = []
    for e in sorted(result.errors.itertuples(), key=lambda e: (-e.from_mps2, e.ahead_s)):
        if e.ahead_s in ahead_s:
            errors = (f'{getattr(e, name) * factor:.3g}' for name, (_, factor) in ERRORS.items())
            between = f'{e.from_mps2:g} to {e.to_mps2:g}'
            rows.append((e.model, between, f'{e.ahead_s:g}', str(e.starts), *errors))
    return table(columns, rows)


@mpl.rc_context(style.RC)
def draw(result: Validation, title: str, path: Path) -> None:
    """Write a figure: errors ahead by lateral acceleration, and each manoeuvre over time."""
    errors, count = result.errors, len(result.manoeuvres)
    figure = style.new_sheet((13, 3.2 * (2 + count)), title)
    grid = figure.add_gridspec(2 + count, 12)
    for i, (low, high) in enumerate(list(pairwise(validation.BINS_MPS2))[1:]):
        for k, (name, (label, factor)) in enumerate(ERRORS.items()):
            axes = figure.add_subplot(grid[i, 4 * k : 4 * k + 4])
            for model, rows in errors[errors['from_mps2'] == low].groupby('model', sort=False):
                values = rows[name] * factor
                axes.plot(rows['ahead_s'], values, 'o-', color=COLOURS[model], label=model)
            axes.set(ylabel=f'rms error, {label}', xlabel='ahead [s]', ylim=(0, None))
            axes.set_title(f'|ay| {low:g} to {high:g} m/s²')
            if not i + k:
                axes.legend()
    for i, m in enumerate(result.manoeuvres):
        t = np.arange(len(m.measured.vx)) * STEP_S
        for k, (name, (label, factor)) in enumerate(SIGNALS.items()):
            axes = figure.add_subplot(grid[2 + i, 3 * k : 3 * k + 3])
            measured = getattr(m.measured, name) * factor
            axes.plot(t, measured, color=style.INK, linewidth=2.8, label='measured')
            for model, motion in m.models.items():
                axes.plot(t, getattr(motion, name) * factor, color=COLOURS[model], label=model)
            room = 0.4 * np.ptp(measured)
            axes.set(ylim=(measured.min() - room, measured.max() + room))
            axes.set(ylabel=label, xlabel='time [s]', title='' if k else m.log)
            if not k:
                axes.legend(fontsize=7)
    figure.savefig(path, metadata={'Software': None})


def write(result: Validation, folder: Path, title: str) -> dict[str, Path]:
    """Write the figure and the numbers; return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = {'figure': folder / 'validation.png', 'numbers': folder / 'validation.json'}
    draw(result, title, paths['figure'])
    manoeuvres = {m.log: m.numbers for m in result.manoeuvres}
    numbers = {'errors': result.errors.to_dict('records'), 'manoeuvres': manoeuvres}
    paths['numbers'].write_text(json.dumps(numbers, indent=1) + '\n')
    return paths
