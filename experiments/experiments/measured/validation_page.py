"""Tables, figure and page of a validation."""

import base64
import html
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bags.figures import style
from experiments.measured import validation
from experiments.measured.validation import Validation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SIGNALS = {
    'r': ('yaw rate', 'deg/s', 180 / np.pi),
    'ay': ('lateral acceleration', 'm/s²', 1.0),
    'vy': ('lateral speed', 'm/s', 1.0),
    'sideslip': ('sideslip', 'deg', 180 / np.pi),
}
ERRORS = {
    'vy': ('lateral speed [m/s]', 1.0),
    'r': ('yaw rate [deg/s]', 180 / np.pi),
    'position': ('position [m]', 1.0),
}
COLOURS = {
    validation.PREDICTION: style.KNOWN['mpcc'],
    validation.LINEAR: style.OTHERS[0],
    validation.HOLD: style.QUIET,
    validation.PLANT: style.KNOWN['frenet'],
    validation.FITTED: style.OTHERS[1],
}
STYLE = 'body{font:15px sans-serif;max-width:75em;margin:2em auto}td,th{padding:.2em .8em;'
STYLE += 'text-align:right}td:first-child,th:first-child{text-align:left}img{max-width:100%}'


def tables(result: Validation) -> list[tuple[str, list[str], list[list[str]]]]:
    """Return title, columns and rows of a table per manoeuvre, and of the errors ahead."""
    shown = []
    for m in result.manoeuvres:
        rows = []
        for model, numbers in m.numbers.items():
            for name, (label, unit, factor) in SIGNALS.items():
                row = [model, f'{label} [{unit}]', f'{numbers[f"{name}_rms_of_range"]:.1%}']
                for word in ('greatest', 'least'):
                    row += [
                        f'{numbers[f"{name}_{word}"] * factor:.3g}',
                        f'{numbers[f"{name}_{word}_error"] * factor:+.2g}',
                        f'{numbers[f"{name}_{word}_late_s"] * 1000:+.0f}',
                    ]
                rows.append(row)
        peaks = [head for word in ('greatest', 'least') for head in (word, 'error', 'late [ms]')]
        columns = ['model', 'signal', 'rms / range', *peaks]
        shown.append((f'Through the manoeuvre of {m.log}', columns, rows))
    columns = [
        'model',
        '|ay| [m/s²]',
        'ahead [s]',
        'starts',
        *(label for label, _ in ERRORS.values()),
    ]
    rows = [
        [e.model, f'{e.from_mps2:g} to {e.to_mps2:g}', f'{e.ahead_s:g}', str(e.starts)]
        + [f'{getattr(e, name) * factor:.3g}' for name, (_, factor) in ERRORS.items()]
        for e in sorted(result.errors, key=lambda e: (-e.from_mps2, e.ahead_s))
    ]
    return [*shown, ('Errors ahead of every measured state, rms', columns, rows)]


def draw(result: Validation, title: str) -> 'Figure':
    """Return errors over the horizon by lateral acceleration, and each manoeuvre over time."""
    count = len(result.manoeuvres)
    figure = style.new_sheet((13, 3.2 * (2 + count)), title)
    grid = figure.add_gridspec(2 + count, 12)
    bins = list(zip(validation.BINS_MPS2, validation.BINS_MPS2[1:]))[1:]
    for i, (low, high) in enumerate(bins):
        for k, (name, (label, factor)) in enumerate(ERRORS.items()):
            axes = figure.add_subplot(grid[i, 4 * k : 4 * k + 4])
            for model, colour in COLOURS.items():
                rows = [e for e in result.errors if (e.model, e.from_mps2) == (model, low)]
                values = [getattr(e, name) * factor for e in rows]
                axes.plot([e.ahead_s for e in rows], values, 'o-', color=colour, label=model)
            axes.set(ylabel=f'rms error, {label}', xlabel='ahead [s]', ylim=(0, None))
            axes.set_title(f'|ay| {low:g} to {high:g} m/s²')
            if not i + k:
                shown = [line for line in axes.lines if len(line.get_xdata())]
                axes.legend(shown, [line.get_label() for line in shown])
    for i, m in enumerate(result.manoeuvres):
        for k, (name, (label, unit, factor)) in enumerate(SIGNALS.items()):
            axes = figure.add_subplot(grid[2 + i, 3 * k : 3 * k + 3])
            measured = m.measured[name] * factor
            axes.plot(m.t, measured, color=style.INK, linewidth=2.8, label='measured')
            for model, signals in m.models.items():
                axes.plot(m.t, signals[name] * factor, color=COLOURS[model], label=model)
            room = 0.4 * np.ptp(measured)
            axes.set(ylim=(measured.min() - room, measured.max() + room))
            axes.set(ylabel=f'{label} [{unit}]', xlabel='time [s]')
            axes.set_title(m.log if not k else '')
            if not k:
                axes.legend(fontsize=7)
    return figure


def write(result: Validation, folder: Path, title: str) -> dict[str, Path]:
    """Write the page, its figure and the numbers; return their paths."""
    # imported late: a second to load
    import matplotlib as mpl
    import pandas

    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(style.RC):
        picture, _ = style.save_figure(draw(result, title), folder / 'validation')
    numbers = {
        'errors': [e._asdict() for e in result.errors],
        'manoeuvres': {m.log: m.numbers for m in result.manoeuvres},
    }
    paths = {'page': folder / 'validation.html', 'numbers': folder / 'validation.json'}
    paths['numbers'].write_text(json.dumps(numbers, indent=1) + '\n')
    image = base64.b64encode(picture.read_bytes()).decode()
    body = f'<img alt="" src="data:image/png;base64,{image}">'
    for heading, columns, rows in tables(result):
        shown = pandas.DataFrame(rows, columns=columns).to_html(index=False, border=0)
        body += f'<h2>{html.escape(heading)}</h2>{shown}'
    title = html.escape(title)
    paths['page'].write_text(
        f'<!doctype html><meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
        f'<h1>{title}</h1>{body}\n'
    )
    return paths | {'figure': picture}
