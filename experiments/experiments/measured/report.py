"""What a fit leaves: car file, numbers, tables, a figure; and a validation: tables and a page."""

import base64
import html
import json
from collections.abc import Sequence
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
import pandas
from matplotlib.figure import Figure
from rich.table import Table

from bags.figures import style
from experiments import console
from experiments.measured import single_track_fit, validation
from experiments.measured.measured_log import STEP_S, Log
from experiments.measured.single_track_fit import KINDS, SIGNALS, Fit, Windows
from experiments.measured.validation import Validation
from mpcc_controller.parameters import CarParams
from node_runtime import parameters

LONGEST_SHOWN = 10  # windows of a log in the figure
ERRORS = {name: SIGNALS[name] for name in ('vy', 'r')} | {'position': ('position [m]', 1.0)}
COLOURS = {
    validation.PREDICTION: style.KNOWN['mpcc'],
    validation.LINEAR: style.OTHERS[0],
    validation.HOLD: style.QUIET,
    validation.PLANT: style.KNOWN['frenet'],
    validation.FITTED: style.OTHERS[1],
}
STYLE = 'body{font:15px sans-serif;max-width:75em;margin:2em auto}td,th{padding:.2em .8em;'
STYLE += 'text-align:right}td:first-child,th:first-child{text-align:left}img{max-width:100%}'


class Judged(NamedTuple):
    """A log, and the fitted car in its windows, in each from its measured state."""

    log: str
    held_out: bool
    measured: Windows
    fitted: Windows

    @property
    def title(self) -> str:
        """The name of the log, and whether it was held out."""
        return self.log + (' (held out)' if self.held_out else '')

    def errors(self) -> dict[str, Any]:
        """Return root mean squares, and ranges of the measured values: vy [m/s], r [rad/s]."""
        pairs = {name: [getattr(part, name) for part in self[2:]] for name in ('vy', 'r')}
        result = {'log': self.log, 'held_out': self.held_out, 'windows': self.measured.vy.shape[1]}
        for name, (measured, fitted) in pairs.items():
            result[f'rms_{name}'] = float(np.sqrt(np.mean((measured - fitted) ** 2)))
        return result | {f'range_{name}': float(np.ptp(pair[0])) for name, pair in pairs.items()}


def fitted_car(car: CarParams, fit: Fit) -> CarParams:
    """Return the car with the tyres and the CoG of a fit."""
    body, moved = car.car, fit.values['cog_to_front_m']
    front, rear = body.cog_to_front_m + moved, body.cog_to_rear_m - moved
    body = replace(body, cog_to_front_m=front, cog_to_rear_m=rear)
    tyre = {name: fit.values[name] for name in type(car.tyre).__dataclass_fields__}
    return replace(car, car=body, tyre=replace(car.tyre, **tyre))


def judge(car: CarParams, fit: Fit, logs: Sequence[Log], held_out: Sequence[Log]) -> list[Judged]:
    """Return each log and what the fit makes of it. Raises BagError for one without a window."""
    judged = []
    for log in (*logs, *held_out):
        measured = single_track_fit.cut([log]).corrected(fit.values)
        fitted = single_track_fit.simulate(car, fit.values, measured)
        judged.append(Judged(log.name, log in held_out, measured, fitted))
    return judged


def error_table(judged: Sequence[Judged]) -> Table:
    """Return the errors as a table."""
    seconds = f'{single_track_fit.WINDOW_S:g} s windows'
    columns = ('log', seconds, 'vy rms [m/s]', 'of range', 'yaw rate rms [deg/s]', 'of range')
    rows = []
    for log in judged:
        e = log.errors()
        vy = f'{e["rms_vy"]:.3f}', f'{e["rms_vy"] / e["range_vy"]:.1%}'
        r = f'{np.degrees(e["rms_r"]):.2f}', f'{e["rms_r"] / e["range_r"]:.1%}'
        rows.append((log.title, str(e['windows']), *vy, *r))
    return console.table(columns, rows)


def parameter_table(fit: Fit) -> Table:
    """Return the parameters with their intervals."""
    rows = []
    for name, value in fit.values.items():
        half = '± ' + f'{fit.half_widths[name]:.2g}' if name in fit.half_widths else 'fixed'
        note = ' [bold](the log does not tell)[/]' if name in fit.vague else ''
        rows.append((name, f'{value:.5g}', half, KINDS[name].unit, KINDS[name].meaning + note))
    columns = ('parameter', 'value', '95 %', 'unit', 'meaning')
    return console.table(columns, rows, left=('parameter', 'unit', 'meaning'))


def write_car(path: Path, car: CarParams, fit: Fit, judged: Sequence[Judged]) -> None:
    """Write the car file, and beside it what `validate` needs to know of the fit as JSON."""
    names = ', '.join(log.log for log in judged if not log.held_out)
    lines = [f'# From {names}; made by', '#   identify --log']
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
    numbers: dict[str, Any] = {**fit._asdict(), 'errors': [log.errors() for log in judged]}
    path.with_suffix('.json').write_text(json.dumps(numbers, indent=1) + '\n')


def read_fit(path: Path) -> Fit | None:
    """Return the fit that was written beside a car file, None where there is none."""
    file = path.with_suffix('.json')
    if not file.is_file():
        return None
    numbers = json.loads(file.read_text())
    return Fit(**{name: numbers[name] for name in Fit._fields})


def draw_fit(judged: Sequence[Judged]) -> Figure:
    """Return measured and fitted motion in the windows of each log in which the car turns most."""
    with mpl.rc_context(style.RC):
        title = 'Measured and fitted, 2 s at a time'
        figure = style.new_sheet((12, 2.6 * len(judged)), title)
        panels = figure.subplots(len(judged), 3, squeeze=False)
        for row, log in zip(panels, judged):
            turn = np.ptp(log.measured.r, axis=0)
            width = min(LONGEST_SHOWN, len(turn))
            first = int(np.argmax(np.convolve(turn, np.ones(width), 'valid')))
            shown = slice(first, first + width)
            t = np.arange(len(log.measured.r))[:, None] * STEP_S
            t = t + np.arange(width) * single_track_fit.WINDOW_S
            for axes, name in zip(row, ('r', 'vy', 'ay')):
                label, factor = SIGNALS[name]
                measured, fitted = (factor * getattr(part, name)[:, shown] for part in log[2:])
                axes.plot(t, measured, color=style.QUIET, linewidth=2.5)
                axes.plot(t, fitted, color=style.KNOWN['mpcc'])
                axes.set(ylabel=label, xlabel='time [s]')
                axes.set_title(log.title)
        lines = panels[0][0].lines
        panels[0][0].legend([lines[0], lines[-1]], ['measured', 'fitted'])
    return figure


def tables(result: Validation) -> dict[str, pandas.DataFrame]:
    """Return by its title, all texts, a table per manoeuvre, and that of the errors ahead."""
    shown = {}
    peaks = [head for word in ('greatest', 'least') for head in (word, 'error', 'late [ms]')]
    for m in result.manoeuvres:
        rows = []
        for model, numbers in m.numbers.items():
            for name, (label, factor) in SIGNALS.items():
                row = [model, label, f'{numbers[f"{name}_rms_of_range"]:.1%}']
                for word in ('greatest', 'least'):
                    row += [
                        f'{numbers[f"{name}_{word}"] * factor:.3g}',
                        f'{numbers[f"{name}_{word}_error"] * factor:+.2g}',
                        f'{numbers[f"{name}_{word}_late_s"] * 1000:+.0f}',
                    ]
                rows.append(row)
        columns = ['model', 'signal', 'rms / range', *peaks]
        shown[f'Through the manoeuvre of {m.log}'] = pandas.DataFrame(rows, columns=columns)
    rows = [
        {'model': e.model, '|ay| [m/s²]': f'{e.from_mps2:g} to {e.to_mps2:g}'}
        | {'ahead [s]': f'{e.ahead_s:g}', 'starts': str(e.starts)}
        | {label: f'{getattr(e, name) * factor:.3g}' for name, (label, factor) in ERRORS.items()}
        for e in sorted(result.errors.itertuples(), key=lambda e: (-e.from_mps2, e.ahead_s))
    ]
    return shown | {'Errors ahead of every measured state, rms': pandas.DataFrame(rows)}


def draw_validation(result: Validation, title: str) -> Figure:
    """Return errors over the horizon by lateral acceleration, and each manoeuvre over time."""
    errors, count = result.errors, len(result.manoeuvres)
    figure = style.new_sheet((13, 3.2 * (2 + count)), title)
    grid = figure.add_gridspec(2 + count, 12)
    for i, (low, high) in enumerate(list(pairwise(validation.BINS_MPS2))[1:]):
        for k, (name, (label, factor)) in enumerate(ERRORS.items()):
            axes = figure.add_subplot(grid[i, 4 * k : 4 * k + 4])
            for model, colour in COLOURS.items():
                rows = errors[(errors['model'] == model) & (errors['from_mps2'] == low)]
                axes.plot(rows['ahead_s'], rows[name] * factor, 'o-', color=colour, label=model)
            axes.set(ylabel=f'rms error, {label}', xlabel='ahead [s]', ylim=(0, None))
            axes.set_title(f'|ay| {low:g} to {high:g} m/s²')
            if not i + k:
                shown = [line for line in axes.lines if len(line.get_xdata())]
                axes.legend(shown, [line.get_label() for line in shown])
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
            axes.set(ylabel=label, xlabel='time [s]')
            axes.set_title(m.log if not k else '')
            if not k:
                axes.legend(fontsize=7)
    return figure


def write_page(result: Validation, folder: Path, title: str) -> dict[str, Path]:
    """Write the page, its figure and the numbers; return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(style.RC):
        picture, _ = style.save_figure(draw_validation(result, title), folder / 'validation')
    numbers = {
        'errors': result.errors.to_dict('records'),
        'manoeuvres': {m.log: m.numbers for m in result.manoeuvres},
    }
    paths = {'page': folder / 'validation.html', 'numbers': folder / 'validation.json'}
    paths['numbers'].write_text(json.dumps(numbers, indent=1) + '\n')
    image = base64.b64encode(picture.read_bytes()).decode()
    body = f'<img alt="" src="data:image/png;base64,{image}">'
    for heading, table in tables(result).items():
        body += f'<h2>{html.escape(heading)}</h2>{table.to_html(index=False, border=0)}'
    title = html.escape(title)
    paths['page'].write_text(
        f'<!doctype html><meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
        f'<h1>{title}</h1>{body}\n'
    )
    return paths | {'figure': picture}
