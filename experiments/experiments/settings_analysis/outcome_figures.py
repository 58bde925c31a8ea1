"""Figures of what happens over the settings: who avoids, and who brakes when."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from bags.errors import BagError
from bags.figures import style
from experiments.results import result_figures, success_surface
from experiments.settings import arms
from experiments.settings_analysis import early_braking, who_avoids
from experiments.settings_analysis.decision_figures import COLOURS as BASELINE_COLOURS
from experiments.settings_analysis.study_tables import Study

COLOURS = {arms.MPCC: '#333333', **BASELINE_COLOURS}
UP = 'S'
ACROSS = {
    'velocity_tolerance_mps': 'velocity tolerance [m/s]',
    'contouring_tolerance_m': 'contouring tolerance [m]',
}
SHOWN = (arms.MPCC, arms.MATCHED)
TICKS = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0)
SHOWN_DIMENSIONS = 6


def write_avoidance(study: Study, across: str, stem: Path) -> list[Path]:
    """Draw the share of settings in which a controller avoids; return the paths of PNG and SVG.

    A row per controller, a column per latency: S over the dimension `across`. Dots are settings,
    white where the controller does not avoid; colours and contours a logistic fit.
    """
    drawn, avoids = who_avoids.find(study)
    latencies = sorted(drawn[who_avoids.LATENCY].unique())
    with mpl.rc_context(style.RC):
        size = (1.4 + 3.2 * len(latencies), 0.9 + 2.7 * len(SHOWN))
        figure = Figure(figsize=size, layout='constrained')
        grid = figure.subplots(len(SHOWN), len(latencies), sharex=True, sharey=True, squeeze=False)
        for row, arm in zip(grid, SHOWN):
            for axes, latency in zip(row, latencies):
                chosen = drawn[who_avoids.LATENCY] == latency
                points = drawn.loc[chosen, [across, UP]].to_numpy(float)
                _surface(axes, points, avoids.loc[chosen, arm].to_numpy(bool))
                held = int(avoids.loc[chosen, arm].sum())
                axes.set_title(f'{latency:g} ms: {held} of {chosen.sum()}', fontsize=9)
            row[0].set_ylabel(f'{arm}\nS: demand / limit')
        for axes in grid[-1]:
            axes.set_xlabel(ACROSS[across])
        for axis, name in (('x', across), ('y', UP)):
            _log_axis(grid[0][0], axis, study.plan.dimensions[name].ends())
        colours = mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, 1.0), result_figures.COLOURS)
        figure.colorbar(colours, ax=grid, label='share that avoids both obstacles')
        return style.save_figure(figure, stem)


def _surface(axes, points, holds):
    try:
        places = np.log10(points).T
        # the counts have intervals; those of twelve surfaces would take minutes
        fitted = success_surface.fit(*places, holds, range(len(holds)), resamples=0)
    except BagError:
        pass  # too few of one kind: the dots are shown alone
    else:
        result_figures.draw_surface(axes, fitted._replace(x=10.0**fitted.x, y=10.0**fitted.y))
    for kind, face in ((holds, style.INK), (~holds, 'white')):
        edge = 'white' if face == style.INK else style.INK
        axes.plot(*points[kind].T, 'o', ms=2.6, mfc=face, mec=edge, mew=0.35)
    axes.grid(visible=False)


def _log_axis(axes, axis, ends):
    getattr(axes, f'set_{axis}scale')('log')
    getattr(axes, f'set_{axis}lim')(*ends)
    ticks = [tick for tick in TICKS if ends[0] <= tick <= ends[1]]
    getattr(axes, f'set_{axis}ticks')(ticks, [f'{tick:g}' for tick in ticks])
    axes.minorticks_off()


def write_dimensions(
    entries: Sequence[Mapping[str, Any]], names: Sequence[str], label: str, stem: Path
) -> list[Path]:
    """Draw shares over the groups of the dimensions that matter most; return the paths.

    `entries` are those of `dimension_shares.by_dimension`, `names` the keys of what is drawn.
    """
    with mpl.rc_context(style.RC):
        figure = Figure(figsize=(10.4, 5.6), layout='constrained')
        panels = figure.subplots(2, SHOWN_DIMENSIONS // 2, sharey=True).flat
        for axes, entry in zip(panels, entries):
            places = np.arange(len(entry['groups']))
            for k, name in enumerate(names):
                shares = entry[name]
                middle = np.array([share['holds'] / max(1, share['of']) for share in shares])
                spread = [
                    middle - [share['low'] for share in shares],
                    [share['high'] for share in shares] - middle,
                ]
                place = places + 0.07 * (k - (len(names) - 1) / 2)
                line = {'color': COLOURS[name], 'marker': 'o', 'ms': 4, 'capsize': 2, 'lw': 1.4}
                axes.errorbar(place, middle, np.abs(spread), label=name, **line)
            texts = [text.replace(' to ', '\nto ') for text in entry['groups']]
            axes.set_xticks(places, texts, fontsize=7.5)
            axes.set_title(entry['dimension'], fontsize=9.5)
            axes.set_ylim(0.0, 1.0)
        handles = figure.axes[0].get_legend_handles_labels()
        figure.supylabel(label, fontsize=9.5)
        figure.legend(*handles, loc='outside lower center', ncols=len(names))
        return style.save_figure(figure, stem)


def write_onsets(study: Study, stem: Path) -> list[Path]:
    """Draw by how much the MPCC brakes earlier, and the least speed beside it; return the paths.

    A dot per setting at the lowest level of the study in which both cars brake; grey is the margin.
    """
    level = study.levels[0]
    margin = study.plan.primaries.brake_onset.margin
    with mpl.rc_context(style.RC):
        figure = Figure(figsize=(9.6, 4.0), layout='constrained')
        panels = figure.subplots(1, 2, sharey=True)
        for axes, baseline in zip(panels, early_braking.BASELINES):
            table = early_braking.compare(study, baseline, level).dropna(subset=['earlier_m'])
            colour = COLOURS[baseline]
            axes.axvspan(-margin, margin, color='#EDEDED')
            axes.axhline(0.0, color=style.EDGE, lw=0.8)
            axes.plot(table['earlier_m'], table['min_speed'], 'o', ms=4, color=colour, alpha=0.7)
            for sign in (-1.0, 1.0):
                earlier_m = study.plan.primaries.brake_onset.earlier_m
                axes.axvline(sign * earlier_m, color=style.EDGE, lw=0.8, ls=':')
            axes.set_title(f'{baseline}: both brake in {len(table)} at {level}', fontsize=9.5)
            axes.set_xscale('symlog', linthresh=2.0)
            ticks = (-100, -30, -10, -2, 0, 2, 10, 30, 100)
            axes.set_xticks(ticks, [f'{tick}' for tick in ticks])
            axes.set_xlim(-150.0, 150.0)
            axes.set_xlabel('the MPCC brakes earlier by [m]')
        panels[0].set_ylabel('the MPCC keeps more least speed by [m/s]')
        return style.save_figure(figure, stem)
