"""The figures of a study: the distributions as dots, the ablation as maps over entry speed."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bags.figures import style
from experiments.study import run_statistics
from experiments.study.run_spec import Draw
from experiments.study.run_statistics import BY_NAME
from experiments.study.runner import Record
from experiments.study.success_curve import SuccessCurve

SHOWN = (
    'min_v2o_m',
    'min_v2e_m',
    'peak_sideslip_deg',
    'min_speed_mps',
    'brake_onset_at_m',
    'solver.iterations_mean',
)
SAFE = {'min_v2o_m': 0.5, 'min_v2e_m': 0.5}  # m, D_sft of mpcc.yaml
COLUMNS = 3
DOTS = 0.7  # of the width of a controller


class Map(NamedTuple):
    """One panel of the ablation: its quantity and colour range."""

    name: str
    title: str
    form: str
    low: float
    high: float
    colours: str


MAPS = (
    Map('cleared', 'cleared, share of runs', '{:.2f}', 0.0, 1.0, 'RdYlBu'),
    Map('min_v2o_m', 'min V2O, median [m]', '{:.2f}', 0.0, 0.8, 'RdYlBu'),
    Map('peak_sideslip_deg', 'peak sideslip, median [deg]', '{:.1f}', 0.0, 15.0, 'RdYlBu_r'),
    Map('brake_onset_at_m', 'brake onset, -500 N [m]', '{:.0f}', 0.0, 140.0, 'cividis'),
    Map('brake_onset_hard_at_m', 'brake onset, -1500 N [m]', '{:.0f}', 0.0, 140.0, 'cividis'),
)
DARK = 0.42  # luminance below which numbers are white


def write_distributions(
    records: Mapping[float, Mapping[str, Sequence[Record]]],
    medians: Mapping[float, Draw],
    stem: Path,
) -> list[Path]:
    """Write the figure as `stem`.png and .svg; return the paths.

    Every run is a dot, the median a line, the median run a ring.
    """
    names = list(next(iter(records.values())))
    colours = style.assign_colours(names)
    with mpl.rc_context(style.RC):
        figure = Figure(figsize=(13.0, 7.4), layout='constrained')
        grid = figure.subplots(len(SHOWN) // COLUMNS, COLUMNS)
        for axes, name in zip(grid.flat, SHOWN):
            _distribution_panel(axes, BY_NAME[name], records, medians, colours)
        keys = [Line2D([], [], ls='', marker='o', ms=5, color=colours[n], label=n) for n in names]
        ring = {'mfc': 'none', 'mec': style.INK, 'ms': 7}
        keys.append(Line2D([], [], ls='', marker='o', label='median run', **ring))
        figure.legend(handles=keys, loc='outside upper right', ncols=len(keys))
        return style.save_figure(figure, stem)


def _distribution_panel(axes, quantity, records, medians, colours):
    axes.set_title(f'{quantity.title} [{quantity.unit}]')
    for group, (kph, by_name) in enumerate(sorted(records.items())):
        width = 0.8 / len(by_name)
        for k, (name, runs) in enumerate(by_name.items()):
            middle = group + width * (k - (len(by_name) - 1) / 2)
            values = [run.value(quantity.name) for run in runs]
            _dots(axes, middle, DOTS * width, values, colours[name], medians[kph].number - 1)
    axes.set_xticks(range(len(records)), [f'{kph:g} km/h' for kph in sorted(records)])
    axes.set_xlim(-0.5, len(records) - 0.5)
    axes.grid(axis='x', visible=False)
    if quantity.name in SAFE:
        low, high = axes.get_ylim()
        axes.axhspan(0.0, SAFE[quantity.name], color=style.UNSAFE, alpha=0.12, lw=0)
        axes.axhline(0.0, color=style.COLLISION, lw=0.9)
        axes.set_ylim(min(low, -0.05), high)


def _dots(axes, middle, width, values, colour, shown):
    """Draw the runs in their order from left to right, without those that have no value."""
    numbers = np.array([np.nan if value is None else value for value in values], dtype=float)
    x = middle + width * (np.linspace(0, 1, len(numbers)) - 0.5)
    axes.plot(x, numbers, 'o', ms=2.6, color=colour, alpha=0.55, mew=0)
    median = run_statistics.summarise(values).median
    if median is not None:
        axes.plot(middle + width * np.array([-0.5, 0.5]), [median] * 2, color=colour, lw=2.2)
    axes.plot(x[shown], numbers[shown], 'o', ms=6.5, mfc='none', mec=style.INK, mew=1.0)


def write_curves(curves: Sequence[SuccessCurve], stem: Path) -> list[Path]:
    """Write the shares of cleared runs over the speed as `stem`.png and .svg; return the paths.

    A panel per controller: the shares with their intervals, and the shares that do not rise.
    """
    colours = style.assign_colours([curve.name for curve in curves])
    rows = -(-len(curves) // COLUMNS)
    with mpl.rc_context(style.RC):
        figure = Figure(figsize=(13.0, 1.0 + 2.6 * rows), layout='constrained')
        grid = figure.subplots(rows, COLUMNS, sharex=True, sharey=True, squeeze=False)
        for axes, curve in zip(grid.flat, curves):
            _curve_panel(axes, curve, colours[curve.name])
        for axes in grid.flat[len(curves) :]:
            axes.set_visible(False)
        figure.supxlabel('entry speed [km/h]', fontsize=9.5)
        figure.supylabel('cleared, share of runs', fontsize=9.5)
        return style.save_figure(figure, stem)


def _curve_panel(axes, curve, colour):
    kph = np.array(curve.speeds_kph)
    share, low, high = np.array(
        [(estimate.share, estimate.low, estimate.high) for estimate in curve.shares]
    ).T
    axes.errorbar(kph, share, (share - low, high - share), fmt='o', ms=4, color=colour, lw=1.0)
    axes.plot(kph, curve.monotone, color=colour, lw=1.6)
    for crossing in curve.crossings:
        axes.axhline(crossing.level, color=style.INK, lw=0.5, ls=':')
    axes.set_title(curve.name, fontsize=9)
    axes.set_ylim(-0.05, 1.05)


def write_ablation(rows: Sequence[Mapping[str, Any]], out: Path) -> list[Path]:
    """Write ablation_<clearance in cm>.png and .svg into `out`; return the paths.

    A row per variant, a column per entry speed, a figure per clearance.
    """
    swept = [row for row in rows if row['clearance_m'] is not None]
    paths = []
    with mpl.rc_context(style.RC):
        for clearance in dict.fromkeys(row['clearance_m'] for row in swept):
            chosen = [row for row in swept if row['clearance_m'] == clearance]
            figure = _ablation_figure(chosen, clearance)
            paths += style.save_figure(figure, out / f'ablation_{round(100 * clearance)}cm')
    return paths


def _ablation_figure(rows, clearance):
    names = list(dict.fromkeys(row['row'] for row in rows))
    speeds = sorted({row['speed_kph'] for row in rows})
    width = 1.6 + len(MAPS) * max(2.2, 0.42 * len(speeds))
    figure = Figure(figsize=(width, 1.3 + 0.26 * len(names)), layout='constrained')
    grid = figure.subplots(1, len(MAPS), sharey=True)
    for axes, shown in zip(grid, MAPS):
        _map(axes, shown, rows, names, speeds)
    grid[0].set_yticks(range(len(names)), names)
    figure.supxlabel('entry speed [km/h]', fontsize=9.5)
    runs = rows[0]['runs']
    title = f'Ablation, requested clearance {clearance:g} m, {runs} paired runs per field'
    figure.suptitle(title, x=0.012, ha='left', fontsize=12, fontweight='bold')
    return figure


def _map(axes, shown, rows, names, speeds):
    values = np.full((len(names), len(speeds)), np.nan)
    for row in rows:
        if row[shown.name] is not None:
            values[names.index(row['row']), speeds.index(row['speed_kph'])] = row[shown.name]
    colours = mpl.colormaps[shown.colours].with_extremes(bad='#F2F2F2')
    look = {'vmin': shown.low, 'vmax': shown.high, 'cmap': colours, 'aspect': 'auto'}
    image = axes.imshow(np.ma.masked_invalid(values), **look)
    for (i, k), value in np.ndenumerate(values):
        text = '–' if np.isnan(value) else shown.form.format(value)
        luminance = np.dot(image.to_rgba(value)[:3], (0.3, 0.59, 0.11))
        colour = 'white' if luminance < DARK and np.isfinite(value) else style.INK
        axes.text(k, i, text, ha='center', va='center', fontsize=6.5, color=colour)
    axes.set_title(shown.title, fontsize=9)
    axes.set_xticks(range(len(speeds)), [f'{kph:g}' for kph in speeds], fontsize=7.5)
    axes.grid(visible=False)
    axes.tick_params(length=0)
