"""The ablation as maps: a row per variant, a column per entry speed, one figure per clearance."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from bags.figures import comparison_figures, style


class Map(NamedTuple):
    """One panel: what it shows, and the ends of its colours."""

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


def write(rows: Sequence[Mapping[str, Any]], out: Path) -> list[Path]:
    """Write ablation_<clearance in cm>.png and .svg into `out`; return the paths."""
    swept = [row for row in rows if row['clearance_m'] is not None]
    paths = []
    with mpl.rc_context(style.RC):
        for clearance in dict.fromkeys(row['clearance_m'] for row in swept):
            chosen = [row for row in swept if row['clearance_m'] == clearance]
            paths += comparison_figures.save_figure(
                _drawn(chosen, clearance), out / f'ablation_{round(100 * clearance)}cm'
            )
    return paths


def _drawn(rows, clearance):
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
    title = f'Ablation, clearance asked for {clearance:g} m, {runs} paired runs per field'
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
