"""Distributions as a figure: every run a dot, the median a line, the median run a ring."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bags.figures import comparison_figures, style
from experiments.study import statistics
from experiments.study.drives import Record
from experiments.study.quantities import BY_NAME
from experiments.study.samples import Draw

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
DOTS = 0.7  # of the room of a controller
STEM = 'distributions'


def write(
    records: Mapping[float, Mapping[str, Sequence[Record]]],
    medians: Mapping[float, Draw],
    out: Path,
) -> list[Path]:
    """Write distributions.png and .svg into `out`; return the paths."""
    names = list(next(iter(records.values())))
    colours = style.assign_colours(names)
    with mpl.rc_context(style.RC):
        figure = Figure(figsize=(13.0, 7.4), layout='constrained')
        grid = figure.subplots(len(SHOWN) // COLUMNS, COLUMNS)
        for axes, name in zip(grid.flat, SHOWN):
            _panel(axes, BY_NAME[name], records, medians, colours)
        keys = [Line2D([], [], ls='', marker='o', ms=5, color=colours[n], label=n) for n in names]
        ring = {'mfc': 'none', 'mec': style.INK, 'ms': 7}
        keys.append(Line2D([], [], ls='', marker='o', label='median run', **ring))
        figure.legend(handles=keys, loc='outside upper right', ncols=len(keys))
        return comparison_figures.save_figure(figure, out / STEM)


def _panel(axes, quantity, records, medians, colours):
    axes.set_title(f'{quantity.title} [{quantity.unit}]')
    for group, (kph, found) in enumerate(sorted(records.items())):
        room = 0.8 / len(found)
        for k, (name, runs) in enumerate(found.items()):
            middle = group + room * (k - (len(found) - 1) / 2)
            values = [run.value(quantity.name) for run in runs]
            _dots(axes, middle, room, values, colours[name], medians[kph].number - 1)
    axes.set_xticks(range(len(records)), [f'{kph:g} km/h' for kph in sorted(records)])
    axes.set_xlim(-0.5, len(records) - 0.5)
    axes.grid(axis='x', visible=False)
    if quantity.name in SAFE:
        low, high = axes.get_ylim()
        axes.axhspan(0.0, SAFE[quantity.name], color=style.UNSAFE, alpha=0.12, lw=0)
        axes.axhline(0.0, color=style.COLLISION, lw=0.9)
        axes.set_ylim(min(low, -0.05), high)


def _dots(axes, middle, room, values, colour, shown):
    """Draw the runs in their order from left to right; those without a value are left out."""
    numbers = np.array([np.nan if value is None else value for value in values], dtype=float)
    x = middle + room * DOTS * (np.linspace(0, 1, len(numbers)) - 0.5)
    axes.plot(x, numbers, 'o', ms=2.6, color=colour, alpha=0.55, mew=0)
    median = statistics.summary(values).median
    if median is not None:
        axes.plot(middle + room * DOTS * np.array([-0.5, 0.5]), [median] * 2, color=colour, lw=2.2)
    axes.plot(x[shown], numbers[shown], 'o', ms=6.5, mfc='none', mec=style.INK, mew=1.0)
