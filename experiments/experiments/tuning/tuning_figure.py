"""The history of a search as a figure: cost of every trial, best so far, cost over each weight."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from bags.figures import style
from bags.figures.style import save_figure

STEM = 'history'
SAFE, OUT, BEST = '#0072B2', '#A6A6A6', '#D55E00'
COLUMNS = 4
CELL = (3.5, 2.5)  # inch
HISTORY_HEIGHT = 3.4  # inch


def write(controller: str, trials: Sequence, best: Any, folder: Path) -> list[Path]:
    """Write the figure into `folder` as PNG and SVG; return the paths.

    `trials` are those of `experiments.tuning.weight_search` in order, the first is the untuned one;
    `best` is one of them.
    """
    names = list(best.weights)
    rows = -(-len(names) // COLUMNS)
    with mpl.rc_context(style.RC):
        size = (CELL[0] * COLUMNS, HISTORY_HEIGHT + CELL[1] * rows)
        figure = Figure(figsize=size, layout='constrained')
        heights = [HISTORY_HEIGHT, *[CELL[1]] * rows]
        grid = figure.add_gridspec(rows + 1, COLUMNS, height_ratios=heights)
        _history(figure.add_subplot(grid[0, :]), trials, best)
        for k, name in enumerate(names):
            cell = grid[1 + k // COLUMNS, k % COLUMNS]
            _weight(figure.add_subplot(cell), trials, best, name)
        figure.suptitle(
            f'Tuning of {controller}', x=0.012, ha='left', fontsize=14, fontweight='bold'
        )
        return save_figure(figure, folder / STEM)


def _history(ax, trials, best):
    cost, safe = _costs(trials)
    order = np.arange(len(trials))
    ax.plot(order[~safe], cost[~safe], 'x', ms=4, color=OUT, label='infeasible')
    ax.plot(order[safe], cost[safe], 'o', ms=3.5, color=SAFE, label='feasible')
    lowest = np.minimum.accumulate(np.where(safe, cost, np.inf))
    ax.step(order, lowest, where='post', color=SAFE, lw=1.4, label='best feasible so far')
    untuned = 'untuned' if trials[0].is_feasible else 'untuned, infeasible'
    ax.axhline(cost[0], color=style.EDGE, lw=0.9, ls=':', label=untuned)
    k = trials.index(best)
    ax.plot(k, cost[k], '*', ms=12, color=BEST, mec='white', label='tuned', zorder=5)
    begins = sum(trial.stage == 1 for trial in trials)
    ax.axvline(begins - 0.5, color=style.EDGE, lw=0.9)
    top = ax.get_xaxis_transform()  # x in data, y in the height of the axes
    for x, text, side in ((begins - 1.5, 'stage 1', 'right'), (begins + 0.5, 'stage 2', 'left')):
        ax.annotate(text, (x, 0.98), xycoords=top, ha=side, va='top', color=style.QUIET)
    ax.set(xlabel='trial', xlim=(-1, len(trials)))
    _cost_axis(ax)
    ax.set_title('Mean of rms velocity error / 1 m/s and peak sideslip angle / 3 deg')
    ax.legend(loc='lower left', bbox_to_anchor=(0.48, 1.0), ncols=5, borderaxespad=0.2)


def _weight(ax, trials, best, name):
    cost, safe = _costs(trials)
    value = np.array([trial.weights[name] for trial in trials])
    ax.plot(value[~safe], cost[~safe], 'x', ms=3, color=OUT)
    ax.plot(value[safe], cost[safe], 'o', ms=2.8, color=SAFE, alpha=0.7, mew=0)
    ax.axvline(trials[0].weights[name], color=style.EDGE, lw=0.9, ls=':')
    ax.plot(best.weights[name], best.cost, '*', ms=11, color=BEST, mec='white', zorder=5)
    ax.set(xscale='log', xlabel=name)
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0), numticks=8))
    ax.xaxis.set_major_formatter(StrMethodFormatter('{x:g}'))
    ax.xaxis.set_minor_formatter(NullFormatter())
    _cost_axis(ax)


def _cost_axis(ax):
    """Logarithmic, so that trials of a hundred times the best cost are not cut off."""
    ax.set(yscale='log', ylabel='objective')
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
    ax.yaxis.set_major_formatter(StrMethodFormatter('{x:g}'))
    ax.yaxis.set_minor_formatter(NullFormatter())


def _costs(trials):
    return np.array([t.cost for t in trials]), np.array([t.is_feasible for t in trials])
