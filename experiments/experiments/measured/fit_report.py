"""What a fit leaves: the car file, its numbers as JSON, a table, and a figure."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rich.table import Table

from bags.figures import style
from experiments import console
from experiments.measured import single_track_fit
from experiments.measured.measured_log import STEP_S, Log
from experiments.measured.single_track_fit import KINDS, Fit, Windows
from mpcc_controller.parameters import CarParams
from node_runtime import parameters

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LONGEST_SHOWN = 10  # windows of a log in the figure


class LogError(NamedTuple):
    """Errors of the fitted car over the windows of a log, each from its measured state."""

    log: str
    held_out: bool
    windows: int
    rms_vy: float  # m/s
    rms_r: float  # rad/s
    range_vy: float  # m/s, greatest less least measured value
    range_r: float


def fitted_car(car: CarParams, fit: Fit) -> CarParams:
    """Return the car with the tyres and the CoG of a fit."""
    moved = fit.values['cog_to_front_m']
    body = replace(
        car.car,
        cog_to_front_m=car.car.cog_to_front_m + moved,
        cog_to_rear_m=car.car.cog_to_rear_m - moved,
    )
    tyre = {name: fit.values[name] for name in type(car.tyre).__dataclass_fields__}
    return replace(car, car=body, tyre=replace(car.tyre, **tyre))


def predict(car: CarParams, fit: Fit, windows: Windows) -> tuple[np.ndarray, ...]:
    """Return measured and predicted vy and r, (rows, windows) each, and the predicted ay."""
    measured = windows.vy - windows.vx * fit.values['sideslip_offset_rad']
    values = {name: np.asarray(value) for name, value in fit.values.items()}
    vy, r, ay = single_track_fit.simulate(car, values, windows, measured[0], windows.r[0])
    return measured, windows.r, vy, r, ay


def errors(
    car: CarParams, fit: Fit, logs: Sequence[Log], held_out: Sequence[Log]
) -> list[LogError]:
    """Return the errors of each log. Raises BagError for one without a window."""
    rows = []
    for log in (*logs, *held_out):
        vy, r, model_vy, model_r, _ = predict(car, fit, single_track_fit.cut([log]))
        rms = (float(np.sqrt(np.mean((a - b) ** 2))) for a, b in ((vy, model_vy), (r, model_r)))
        ranges = float(np.ptp(vy)), float(np.ptp(r))
        rows.append(LogError(log.name, log in held_out, vy.shape[1], *rms, *ranges))
    return rows


def error_table(rows: Sequence[LogError]) -> Table:
    """Return the errors as a table."""
    seconds = f'{single_track_fit.WINDOW_S:g} s windows'
    columns = ('log', seconds, 'vy rms [m/s]', 'of range', 'yaw rate rms [deg/s]', 'of range')
    texts = [
        (
            f'{row.log}{" (held out)" if row.held_out else ""}',
            str(row.windows),
            *(f'{row.rms_vy:.3f}', f'{row.rms_vy / row.range_vy:.1%}'),
            *(f'{np.degrees(row.rms_r):.2f}', f'{row.rms_r / row.range_r:.1%}'),
        )
        for row in rows
    ]
    return console.table(columns, texts)


def parameter_table(fit: Fit) -> Table:
    """Return the parameters with their intervals."""
    rows = []
    for name, value in fit.values.items():
        half = '± ' + f'{fit.half_widths[name]:.2g}' if name in fit.half_widths else 'fixed'
        note = ' [bold](the log does not tell)[/]' if name in fit.vague else ''
        rows.append((name, f'{value:.5g}', half, KINDS[name].unit, KINDS[name].meaning + note))
    columns = ('parameter', 'value', '95 %', 'unit', 'meaning')
    return console.table(columns, rows, left=('parameter', 'unit', 'meaning'))


def write_car(path: Path, car: CarParams, fit: Fit, rows: Sequence[LogError]) -> None:
    """Write the car file, and beside it what `validate` needs to know of the fit as JSON."""
    names = ', '.join(row.log for row in rows if not row.held_out)
    lines = [f'# From {names}; made by', '#   identify --log']
    for name, half in fit.half_widths.items():
        note = ': not told by the log' if name in fit.vague else ''
        unit = KINDS[name].unit
        lines.append(f'# {name}: {fit.values[name]:.5g} +- {half:.2g} {unit} (95 %){note}')
    lines += ['/**:', '  ros__parameters:']
    leaves, group = parameters.leaves(CarParams), ''
    for key, value in parameters.flatten(fitted_car(car, fit)).items():
        head, name = key.split('.')
        if head != group:
            lines.append(f'    {head}:')
            group = head
        if value is not None:
            unit = getattr(leaves[key].rule, 'unit', '')
            lines.append(f'      {name}: {float(f"{value:.6g}")!r}  # {unit}'.rstrip(' #'))
    path.write_text('\n'.join(lines) + '\n')
    numbers: dict[str, Any] = {**fit._asdict(), 'errors': [row._asdict() for row in rows]}
    path.with_suffix('.json').write_text(json.dumps(numbers, indent=1) + '\n')


def read_fit(path: Path) -> Fit | None:
    """Return the fit that was written beside a car file, None where there is none."""
    file = path.with_suffix('.json')
    if not file.is_file():
        return None
    numbers = json.loads(file.read_text())
    return Fit(**{name: numbers[name] for name in Fit._fields})


def draw(car: CarParams, fit: Fit, logs: Sequence[Log], held_out: Sequence[Log]) -> 'Figure':
    """Return measured and fitted motion in the windows of each log in which the car turns most."""
    import matplotlib as mpl

    with mpl.rc_context(style.RC):
        every = (*logs, *held_out)
        figure = style.new_sheet((12, 2.6 * len(every)), 'Measured and fitted, 2 s at a time')
        panels = figure.subplots(len(every), 3, squeeze=False)
        for row, log in zip(panels, every):
            windows = single_track_fit.cut([log])
            turn = np.ptp(windows.r, axis=0)
            width = min(LONGEST_SHOWN, len(turn))
            first = int(np.argmax(np.convolve(turn, np.ones(width), 'valid')))
            windows = windows.take(slice(first, first + width))
            vy, r, model_vy, model_r, model_ay = predict(car, fit, windows)
            t = np.arange(len(vy))[:, None] * STEP_S + np.arange(width) * single_track_fit.WINDOW_S
            signals = (
                ('yaw rate [deg/s]', np.degrees(r), np.degrees(model_r)),
                ('lateral speed [m/s]', vy, model_vy),
                ('lateral acceleration [m/s²]', windows.ay, model_ay),
            )
            for axes, (label, measured, modelled) in zip(row, signals):
                axes.plot(t, measured, color=style.QUIET, linewidth=2.5)
                axes.plot(t, modelled, color=style.KNOWN['mpcc'])
                axes.set(ylabel=label, xlabel='time [s]')
                axes.set_title(log.name + (' (held out)' if log in held_out else ''))
        lines = panels[0][0].lines
        panels[0][0].legend([lines[0], lines[-1]], ['measured', 'fitted'])
    return figure
