"""The figures of a study over many settings: shares, phase diagrams, causes, drivers."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.colors import LinearSegmentedColormap, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bags.figures import style
from experiments.settings import arms
from experiments.settings_analysis import decide, study_tables, verdicts
from experiments.settings_analysis.decide import Judged, Results
from experiments.settings_analysis.study_tables import Study

TITLES = {
    'unsafe_area': 'baseline in an unsafe area, MPCC not',
    'sideslip': 'sideslip: baseline large, MPCC small',
    'brake_onset': 'MPCC brakes earlier',
    'min_speed': 'MPCC keeps the higher speed',
    'conjunction': 'all four together',
}
# of the differences
DIRECTIONS = {
    'unsafe_area': 'the MPCC keeps more distance',
    'sideslip': 'the baseline slides more',
    'brake_onset': 'the MPCC brakes earlier',
    'min_speed': 'the MPCC keeps more speed',
}
COLOURS = {arms.MATCHED: '#D55E00', arms.LINEAGE: '#0072B2', arms.TUNED: '#009E73'}
HOLDS, SAME, OPPOSITE = '#0072B2', '#BDBDBD', '#D55E00'
ACROSS, UP, PANELS = 'velocity_tolerance_mps', 'S', 'latency_ms'
CELLS = 4  # of a phase diagram in each direction
LEAST_OF_CELL = 5  # settings, to colour a cell
SHOWN_TERMS, SHOWN_DIMENSIONS = 8, 8


def write_shares(study: Study, results: Results, stem: Path) -> list[Path]:
    """Draw the share of settings in which each claim holds, with intervals; return the paths.

    Filled: the level at which the claim is judged. The thin line spans what undetermined settings
    might make of it.
    """
    shown = [result for result in results.judged if result.primary and result.decision.settings]
    claims = [name for name in TITLES if any(result.claim == name for result in shown)]
    with mpl.rc_context(style.RC):
        figure = Figure(figsize=(9.0, 1.6 + 0.9 * max(1, len(claims))), layout='constrained')
        axes = figure.subplots()
        for result in shown:
            place = len(claims) - 1 - claims.index(result.claim)
            _share(axes, result, place + 0.3 * (0.7 - study.baselines.index(result.baseline)))
        rule = decide.rule_of(study.plan)
        for end, text in ((rule.rare_below, 'rare'), (rule.holds_from, 'most')):
            axes.axvline(end, color=style.EDGE, lw=0.9, ls=':')
            axes.annotate(text, (end, 1.0), xycoords=('data', 'axes fraction'), va='bottom')
        levels = {result.claim: result.level for result in shown}
        labels = [f'{TITLES[name]}  ({levels[name]})' for name in reversed(claims)]
        axes.set_yticks(range(len(claims)), labels)
        axes.set(xlim=(0.0, 1.0), ylim=(-0.6, len(claims) - 0.3))
        axes.set_xlabel('share of the settings that meet the preconditions, 95 % interval')
        keys = [
            Line2D([], [], ls='', marker='o', color=COLOURS[name], label=name)
            for name in study.baselines
        ]
        axes.legend(handles=keys, loc='lower right', frameon=True)
        return style.save_figure(figure, stem)


def _share(axes, result: Judged, y):
    decision = result.decision
    colour = COLOURS[result.baseline]
    axes.plot((decision.least.low, decision.most.high), (y, y), color=colour, lw=0.8)
    axes.plot(decision.interval, (y, y), color=colour, lw=3.0, alpha=0.6)
    axes.plot(decision.share, y, 'o', ms=6, color=colour, mec='white', clip_on=False, zorder=4)
    text = f'{decision.holds} of {decision.settings}: {result.verdict}'
    place = {'xytext': (0, 5), 'textcoords': 'offset points', 'fontsize': 7.5}
    side = 'left' if decision.share < 0.6 else 'right'
    axes.annotate(text, (decision.share, y), ha=side, color=style.QUIET, **place)


def write_maps(study: Study, baseline: str, stem: Path) -> list[Path]:
    """Draw where in the space each claim's direction holds; return the paths.

    A row per claim, a column per latency: S over the velocity tolerance. A dot is a setting in
    which no car crashes, coloured by the sign of its difference beyond the margin; a field is
    coloured by the mean of these signs and says how many of its settings go the paper's way.
    """
    own = study.outcomes[study.outcomes['baseline'] == baseline]
    reached = study_tables.reaching(own, decide.DRIVER_LEVEL, decide.ANY_S)
    drawn = study_tables.dimensions(study)
    latencies = sorted(drawn[PANELS].unique())
    claims = list(decide.UNITS)
    with mpl.rc_context(style.RC):
        size = (2.2 + 3.1 * len(latencies), 0.9 + 2.45 * len(claims))
        figure = Figure(figsize=size, layout='constrained')
        grid = figure.subplots(len(claims), len(latencies), sharex=True, sharey=True, squeeze=False)
        for row, claim in zip(grid, claims):
            margin = study_tables.margin(study.plan, claim)
            table = _differences(reached, claim, margin).join(drawn)
            for axes, latency in zip(row, latencies):
                _phase(axes, table[table[PANELS] == latency], margin, study.plan)
            row[0].set_ylabel(f'{DIRECTIONS[claim]}\nS: demand / limit', fontsize=8)
        for axes, latency in zip(grid[0], latencies):
            axes.set_title(f'latency {latency:g} ms')
        for axes in grid[-1]:
            axes.set_xlabel('velocity tolerance [m/s]')
        _map_keys(figure, baseline)
        return style.save_figure(figure, stem)


def _differences(reached, claim, margin):
    return verdicts.summarise(study_tables.pairs(reached, claim, decide.DRIVER_LEVEL), margin)


def _map_keys(figure, baseline):
    texts = {HOLDS: 'as in the paper', SAME: 'within the margin', OPPOSITE: 'the other way'}
    keys = [
        Line2D([], [], ls='', marker='o', ms=5, color=colour, label=text)
        for colour, text in texts.items()
    ]
    figure.legend(handles=keys, loc='outside lower right', ncols=len(keys))
    title = f'Which way the paired difference goes, {baseline} against the MPCC'
    figure.suptitle(title, x=0.012, ha='left', fontsize=12, fontweight='bold')


def _phase(axes, table, margin, plan):
    ranges = {name: plan.dimensions[name].ends() for name in (ACROSS, UP)}
    edges_x = np.geomspace(*ranges[ACROSS], CELLS + 1)
    edges_y = np.geomspace(*ranges[UP], CELLS + 1)
    values = table.dropna(subset=['difference'])
    x, y = values[ACROSS].to_numpy(float), values[UP].to_numpy(float)
    sign = np.where(np.abs(values['difference']) <= margin, 0.0, np.sign(values['difference']))
    counts, *_ = np.histogram2d(x, y, [edges_x, edges_y])
    ahead, behind = (
        np.histogram2d(x[sign == side], y[sign == side], [edges_x, edges_y])[0] for side in (1, -1)
    )
    mean = np.where(counts >= LEAST_OF_CELL, (ahead - behind) / np.maximum(counts, 1), np.nan)
    fields = LinearSegmentedColormap.from_list('sign', [OPPOSITE, '#EDEDED', HOLDS])
    fields = fields.with_extremes(bad='white')
    axes.pcolormesh(edges_x, edges_y, mean.T, cmap=fields, vmin=-1, vmax=1, alpha=0.4)
    for (i, k), count in np.ndenumerate(counts):
        if count >= LEAST_OF_CELL:
            middle = np.sqrt(edges_x[i] * edges_x[i + 1]), edges_y[k] * 1.02
            text = f'{ahead[i, k]:.0f} of {count:.0f}'
            axes.text(*middle, text, ha='center', va='bottom', fontsize=6.5, color=style.INK)
    palette = ListedColormap([OPPOSITE, SAME, HOLDS])
    axes.scatter(x, y, c=sign, cmap=palette, vmin=-1, vmax=1, s=11, edgecolor='white', lw=0.4)
    axes.set(xscale='log', yscale='log', xlim=ranges[ACROSS], ylim=ranges[UP])
    ticks = [tick for tick in (1, 3, 10, 30) if ranges[ACROSS][0] <= tick <= ranges[ACROSS][1]]
    axes.set_xticks(ticks, [f'{tick:g}' for tick in ticks])
    ticks = [tick for tick in (0.1, 0.2, 0.4, 0.8) if ranges[UP][0] <= tick <= ranges[UP][1]]
    axes.set_yticks(ticks, [f'{tick:g}' for tick in ticks])
    axes.minorticks_off()
    axes.grid(visible=False)


def write_causes(results: Results, stem: Path) -> list[Path]:
    """Draw the largest effects of the factorial on each claim's response; return the paths."""
    shown = {claim: effects for claim, effects in results.effects.items() if effects}
    if not shown:
        return []
    with mpl.rc_context(style.RC):
        figure = Figure(figsize=(12.0, 3.4), layout='constrained')
        grid = figure.subplots(1, len(shown), squeeze=False)[0]
        for axes, (claim, effects) in zip(grid, shown.items()):
            chosen = sorted(effects, key=lambda effect: -abs(effect.mean))[:SHOWN_TERMS][::-1]
            for k, effect in enumerate(chosen):
                sure = effect.p_adjusted <= decide.SIGNIFICANT
                colour = HOLDS if sure else SAME
                axes.plot(effect.interval, (k, k), color=colour, lw=2.4)
                axes.plot(effect.mean, k, 'o', ms=5, color=colour)
            axes.axvline(0.0, color=style.EDGE, lw=0.9)
            axes.set_yticks(range(len(chosen)), [effect.term for effect in chosen], fontsize=7.5)
            axes.set_title(f'{decide.RESPONSES[claim]}', fontsize=9)
            axes.set_xlabel(
                f'effect [{decide.UNITS.get(claim, "-")}], {chosen[0].settings} settings'
            )
        figure.suptitle(
            'From MPCC to baseline, one factor or interaction at a time; blue: beyond chance',
            x=0.012,
            ha='left',
            fontsize=12,
            fontweight='bold',
        )
        return style.save_figure(figure, stem)


def write_drivers(study: Study, results: Results, stem: Path) -> list[Path]:
    """Draw total and first-order Sobol' indices of every usable surrogate; return the paths."""
    shown = {key: surrogate for key, surrogate in results.drivers.items() if surrogate.is_usable}
    if not shown:
        return []
    with mpl.rc_context(style.RC):
        columns = min(4, len(shown))
        rows = -(-len(shown) // columns)
        figure = Figure(figsize=(3.6 * columns, 0.5 + 2.7 * rows), layout='constrained')
        panels = list(figure.subplots(rows, columns, squeeze=False).flat)
        for axes, ((baseline, claim), surrogate) in zip(panels, shown.items()):
            _driver_bars(axes, surrogate.drivers[:SHOWN_DIMENSIONS][::-1])
            axes.set_title(
                f'{claim}, {baseline}\ncross-validated R² {surrogate.score:.2f}', fontsize=8.5
            )
        for axes in panels[len(shown) :]:
            axes.set_visible(False)
        panels[0].legend(loc='lower right')
        return style.save_figure(figure, stem)


def _driver_bars(axes, drivers: Sequence):
    frame = pd.DataFrame(drivers)
    places = np.arange(len(frame))
    axes.barh(places, frame['total'], height=0.7, color='#9ECAE1', label='total')
    axes.barh(places, frame['first'].clip(lower=0.0), height=0.35, color=HOLDS, label='first order')
    axes.errorbar(
        frame['total'], places, xerr=frame['total_interval'], fmt='none', ecolor=style.INK, lw=0.8
    )
    axes.set_yticks(places, frame['dimension'], fontsize=7)
    axes.set_xlabel("Sobol' index")
    axes.grid(axis='y', visible=False)
