"""What the rows of the study say: text and tables, and a figure for each estimand.

Lines over a point of a figure are its interval of 95 % over replicates.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from rich.console import Console

from bags.command_line import print_paths, print_text
from bags.figures import style
from experiments.families.lane_change_task import DEMAND
from experiments.tuned_study import analysis, exchange, picture, run
from experiments.tuned_study.analysis import DIFFERENCE, LIMIT_SHARE, QUANTITIES, Results, Row
from experiments.tuned_study.arms import COMPARED
from experiments.tuned_study.exchange import AHEAD_S, ALL, BOTH, WEIGHTS, Exchange
from experiments.tuned_study.picture import Marginal

TEXT = 'decided.txt'
WIDTH_INCH = 6.0  # 900 pixels
LABELS = {
    'mpcc': 'tuned MPCC',
    'frenet': 'tuned baseline',
    'mpcc_heading': 'tuned MPCC with heading cost',
    'frenet_matched': "baseline, MPCC's weights, no heading cost",
    'frenet_lineage': 'baseline, published tolerances',
    'mpcc_shipped': 'MPCC, weights set by hand',
    'frenet_shipped': 'baseline, weights set by hand',
}
FACTOR_LABELS = {
    'frame': 'path frame',
    'lag': 'no lag cost',
    'heading': 'heading cost',
    'shape': 'step priority',
}
LATENCY_LABELS = {
    '0 ms': 'none',
    '25 ms': '25 ms, unknown\nto the controller',
    '50 ms': '50 ms, unknown\nto the controller',
    'compensated': '50 ms, in its model\nwith the servos',
}
MARKERS = ('o', 's', 'D', '^', 'v', 'P', 'X')
AVOIDED = 'tasks avoided [%]'
MOST_SHOWN = 12  # parameters of the picture
SHADE = {'color': '#E4E4E4', 'lw': 0, 'zorder': 0.5}


def typical(plan: Mapping[str, Any], tuned: pd.DataFrame, arm: str) -> pd.Series:
    """Return the replicate of an arm whose weights are nearest to the median ones.

    In shares of the logarithm of each range, by the sum of squares.
    """
    own = tuned[tuned['arm'] == arm].set_index('replicate').dropna(axis=1)
    ranges = {name: ends for name, ends in plan['search']['ranges'].items() if name in own}
    shares = pd.DataFrame(
        {name: np.log(own[name] / low) / np.log(high / low) for name, (low, high) in ranges.items()}
    )
    nearest = ((shares - shares.median()) ** 2).sum(axis=1).idxmin()
    return own.loc[nearest, list(ranges)].rename(nearest)


def write(plan: Mapping[str, Any], folder: Path, out: Path, console: Console) -> None:
    """Show what the tables in `folder` say, and write it with its figures into `out`.

    Raises BagError for a folder without the tables.
    """
    tables = {name: run.read(folder, name) for name in (*run.TABLES, run.PICTURE)}
    results = analysis.analyse(plan, tables['drives'])
    errors = tables['drives']['error'].ne('').sum()
    lines = [
        f'{len(tables["drives"]):,} drives, {errors} of them without a result: not avoided',
        analysis.to_text(results),
        '',
        'weights of the replicate nearest to the median',
    ]
    for arm in plan['tuned']:
        weights = typical(plan, tables['tuned'], arm)
        shown = ', '.join(f'{name} {value:.4g}' for name, value in weights.items())
        lines.append(f'  {arm}, replicate {weights.name}: {shown}')
        own, ranges = tables['tuned'].query('arm == @arm'), plan['search']['ranges']
        at = pd.DataFrame({name: own[name].isin(ranges[name]) for name in weights.index})
        shown = ', '.join(f'{name} {count}' for name, count in at.sum().items() if count)
        count = f'{at.any(axis=1).sum()} of {len(at)} ({shown})'
        lines.append(f'  searches that chose an end of a range: {count}')
    distances = picture.distances(tables['picture'], plan['picture'])
    drawn = tables['picture'].set_index('arm')
    nearest = drawn[drawn['task'].isin(distances.index[:1])]
    lines += [
        '',
        f'picture: the MPCC keeps every safety distance in {len(distances)} draws, and '
        f'every item holds in {(distances == 0).sum()}; the nearest:',
        nearest[['S', *analysis.QUANTITIES]].to_string(float_format='{:.2f}'.format),
    ]
    marginals = picture.marginals(tables['picture'], plan['picture'])
    for row in marginals:
        before, after = (' '.join(f'{value:10.4g}' for value in v) for v in row[1:3])
        lines.append(f'  {row.name:40}{before} ->{after}  p {row.p_value:.3f}')
    text = '\n'.join(lines)
    print_text(console, text)
    out.mkdir(parents=True, exist_ok=True)
    (out / TEXT).write_text(f'{text}\n', encoding='utf-8')
    paths = write_figures(results, tables['trials'], marginals, plan, DEMAND, out / 'figures')
    print_paths(console, {'figures': paths[0].parent})


def explain(plan: Mapping[str, Any], folder: Path, out: Path, console: Console) -> None:
    """Exchange parts of both controllers in a task that one avoids; write the figure into `out`.

    In the replicate whose MPCC is nearest to the median. Raises BagError for a folder without the
    tables, and where both avoid the same tasks.
    """
    tables = {name: run.read(folder, name) for name in ('tuned', 'drives')}
    exchanged = exchange.explain(plan, tables, int(typical(plan, tables['tuned'], 'mpcc').name))
    lines = [
        f'replicate {exchanged.replicate}, task {exchanged.task}: {exchanged.avoids} alone avoids',
        f'shift of the planned lateral position {exchange.AHEAD_S:g} s ahead, rms [m]',
        *(f'  {name:24}{size:.3f}' for name, size in exchanged.sizes().items()),
    ]
    print_text(console, '\n'.join(lines))
    folder = out / 'figures'
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(style.RC):
        paths = style.save_figure(draw_exchange(exchanged), folder / 'exchange')
    print_paths(console, {'figure': paths[0]})


def write_figures(
    results: Results,
    trials: pd.DataFrame,
    marginals: Sequence[Marginal],
    plan: Mapping[str, Any],
    span: tuple[float, float],
    folder: Path,
) -> list[Path]:
    """Write every figure into a folder; return the paths of PNG and SVG.

    `trials` are the points of the searches, `marginals` the parameters of the picture, `span` is
    the range of S of the tasks.
    """
    with mpl.rc_context(style.RC):
        drawn = {
            'avoidance_gap': draw_gap(results, plan, span),
            'limit_ratio': draw_limits(results.limits, span),
            'sensitivity': draw_losses(results.losses),
            'win_balance': draw_balances(results.balances, plan),
            'search_cost': draw_searches(trials),
        }
        effects = [row for row in results.effects if np.isfinite(row.estimate.low)]
        if effects:  # of a factorial with several tasks in which a quantity has a value
            drawn['mechanism'] = draw_effects(effects)
        if marginals:  # or no draw that shows the MPCC's part of the picture
            drawn['picture'] = draw_picture(marginals)
        folder.mkdir(parents=True, exist_ok=True)
        return [
            path
            for name, figure in drawn.items()
            for path in style.save_figure(figure, folder / name)
        ]


def draw_gap(results: Results, plan: Mapping[str, Any], span: tuple[float, float]) -> Figure:
    """Return the avoidance of every arm over S, and the gap of the compared arms below."""
    figure, (above, below) = _sheet('How many tasks does each controller avoid, by demand?', 6.4, 2)
    strata = sorted({row.group for row in results.shares} - {'all'}, key=int)
    edges = np.linspace(*span, len(strata) + 1)
    places = (edges[:-1] + edges[1:]) / 2
    names = [name for name in LABELS if any(row.name == name for row in results.shares)]
    colours = style.assign_colours([name.removesuffix('_shipped') for name in names])
    for k, name in enumerate(names):
        shift = (k - (len(names) - 1) / 2) * 0.007
        _points(
            *(above, places + shift, _select(results.shares, strata, name=name), 100),
            label=LABELS[name],
            color=colours[name.removesuffix('_shipped')],
            marker=MARKERS[k],
            ls=':' if name.endswith('_shipped') else '-',
        )
    above.set(ylabel=AVOIDED, ylim=(-3, 103), title='Avoided, by controller')
    margin = 100 * plan['confirmatory']['avoidance_gap']['margin']
    below.axhspan(-margin, margin, label=f'margin: ±{margin:g} points', **SHADE)
    _points(below, places, _select(results.gaps, strata, name=DIFFERENCE), 100, ls='-')
    overall = _select(results.gaps, ['all'], name=DIFFERENCE)[0].estimate
    label = f'all tasks: {100 * overall.mean:+.1f} points, 95 %'
    below.axhspan(100 * overall.low, 100 * overall.high, color='#56B4E9', alpha=0.45, lw=0)
    below.axhline(100 * overall.mean, color=style.KNOWN['mpcc'], lw=1.5, label=label)
    below.set(ylabel='difference [points]', title='Tuned MPCC less tuned baseline')
    below.set_xlabel('demand S: lateral acceleration that the task requires, over the limit')
    below.legend(loc='best')
    low, high = below.get_ylim()
    below.set_ylim(min(low, -margin - 1), max(high, margin + 1))
    figure.legend(*above.get_legend_handles_labels(), loc='outside lower center', ncols=2)
    return figure


def draw_limits(rows: Sequence[Row], span: tuple[float, float]) -> Figure:
    """Return the limit demand of each arm, and the ratio of both, by latency."""
    figure, (above, below) = _sheet(
        'Up to which demand does each controller avoid nine of ten?', 5.6, 2
    )
    groups = [group for group in LATENCY_LABELS if any(row.group == group for row in rows)]
    places = np.arange(len(groups), dtype=float)
    for k, name in enumerate(COMPARED):
        look = {'label': LABELS[name], 'color': style.KNOWN[name], 'marker': MARKERS[k]}
        _points(above, places + 0.16 * (k - 0.5), _select(rows, groups, name=name), **look)
    above.set(ylabel=f'demand S, {100 * LIMIT_SHARE:g} % avoided')
    above.set_ylim(span[0] - 0.02, span[1] + 0.02)
    above.set_title(f'S90, where it is within {span[0]:.1f} to {span[1]:.1f}')
    above.legend(loc='best')
    ratios = _select(rows, groups, what='ratio')
    _points(below, places, ratios)
    below.axhline(1.0, color=style.REFERENCE, lw=1)
    below.set(ylabel='ratio', title='MPCC over baseline; above 1 the MPCC gets further')
    below.set_xlabel('time from a command to the actuators')
    for axes, own in ((above, rows), (below, ratios)):
        axes.set_xticks(places, [LATENCY_LABELS[group] for group in groups])
        axes.set_xlim(-0.5, len(groups) - 0.5)
        for place, group in zip(places, groups):
            if any(np.isnan(row.estimate.mean) for row in _select(own, [group])):
                look = {'ha': 'center', 'color': style.QUIET}
                middle = {'xy': (place, 0.5), 'xycoords': ('data', 'axes fraction')}
                axes.annotate('outside\nthe range', **middle, **look)
    return figure


def draw_losses(rows: Sequence[Row]) -> Figure:
    """Return what wrong friction and latency cost each arm in avoidance."""
    names = {
        analysis.HIGH: 'friction believed\n5 % too high',
        analysis.LOW: 'friction believed\n5 % too low',
        analysis.LATENCY: 'per 25 ms of latency\nthat it does not know',
        analysis.KNOWN_LATENCY: '50 ms, in its model\nwith the servos',
    }
    figure, axes = _sheet('How much avoidance do wrong friction and latency cost?', 3.9)
    places = np.arange(len(names), dtype=float)
    labels = {**LABELS, DIFFERENCE: 'difference: below 0 the MPCC loses less'}
    for k, name in enumerate((*COMPARED, DIFFERENCE)):
        look = {'label': labels[name], 'color': style.KNOWN.get(name, style.INK)}
        own = _select(rows, names, name=name)
        _points(axes, places + 0.2 * (k - 1), own, 100, marker=MARKERS[k], **look)
    axes.axhline(0.0, color=style.REFERENCE, lw=1)
    axes.set_xticks(places, names.values())
    axes.set(ylabel='avoidance lost [points]', xlim=(-0.5, len(names) - 0.5))
    figure.legend(loc='outside lower center', ncols=3)
    return figure


def draw_balances(rows: Sequence[Row], plan: Mapping[str, Any]) -> Figure:
    """Return how often the first arm of each pair is better and worse, by quantity."""
    pairs = list(dict.fromkeys(row.name for row in rows))
    figure, panels = _sheet('Who is better, task by task?', 1.2 + 1.75 * len(pairs), len(pairs))
    margin = 100 * plan['confirmatory']['sideslip_balance']['margin']
    places, least = np.arange(len(QUANTITIES), dtype=float)[::-1], analysis.better_by(plan)
    labels = [f'{q.label}\n{least[what]:g} {q.unit} {q.better}' for what, q in QUANTITIES.items()]
    panels = np.atleast_1d(panels)
    for axes, pair in zip(panels, pairs):
        first, second = pair.split(' - ')
        for group, sign, name in (('better', 1, first), ('worse', -1, second)):
            shares = [100 * sign * row.estimate.mean for row in _select(rows, [group], name=pair)]
            colour = style.KNOWN[name.partition('_')[0]]
            axes.barh(places, shares, 0.6, color=colour, alpha=0.35)
        if pair == DIFFERENCE:  # the pair and the first of the quantities have a verdict
            label = f'margin: ±{margin:g} points'
            axes.barh(places[0], 2 * margin, 0.95, -margin, label=label, **SHADE)
        own = _select(rows, ['balance'], name=pair)
        look = {'ms': 4, 'capsize': 3, 'lw': None}
        label = 'balance: share better less share worse'
        _points(axes, places, own, 100, across=True, label=label, **look)
        axes.axvline(0.0, color=style.REFERENCE, lw=1)
        axes.set_yticks(places, labels)
        axes.set(xlim=(-100, 100))
        axes.xaxis.set_major_formatter(lambda value, _: f'{abs(value):g}')
        axes.set_title(f'{LABELS[second]} better', fontsize=8, color=style.KNOWN['frenet'])
        axes.set_title(
            f'{LABELS[first]} better', loc='right', fontsize=8, color=style.KNOWN['mpcc']
        )
    axes.set_xlabel('share of tasks [%]; a failure is worst, two failures tie; whiskers: 95 %')
    figure.legend(*panels[0].get_legend_handles_labels(), loc='outside lower center', ncols=2)
    return figure


def draw_effects(rows: Sequence[Row]) -> Figure:
    """Return what each difference of the two formulations does, and each pair of them."""
    quantities = list(dict.fromkeys(row.what for row in rows))
    title = 'What do parts of the baseline change, and pairs of them (×)?'
    figure, panels = _sheet(title, 4.6, 1, len(quantities))
    names = [row.name for row in rows if row.what == quantities[0]]
    places = np.arange(len(names), dtype=float)[::-1]
    for axes, what in zip(panels, quantities):
        effects, others = (_select(rows, [kind], what=what) for kind in ('effect', 'interaction'))
        look = {'across': True, 'ms': 4, 'capsize': 2, 'lw': None}
        _points(axes, places[: len(effects)], effects, **look)
        _points(axes, places[len(effects) :], others, **look, color=style.QUIET, marker='D')
        axes.axvline(0.0, color=style.REFERENCE, lw=1)
        means, errors = _bars([*effects, *others], 1)
        # rounding errors are no effect
        reach = max(1e-3, 1.3 * np.nanmax(np.abs(means) + errors.max(axis=0)))
        tick = float(f'{0.6 * reach:.1g}')
        axes.set_xlim(-reach, reach)
        axes.set_xticks([-tick, 0.0, tick], [f'{-tick:g}', '0', f'{tick:g}'], fontsize=7)
        axes.set_title(QUANTITIES[what].label.replace(' ', '\n').replace('of\n', 'of '), fontsize=8)
        axes.set_xlabel(QUANTITIES[what].unit)
        axes.set_yticks(places, [])
        axes.set_ylim(-0.6, len(names) - 0.4)
    labels = [' × '.join(FACTOR_LABELS[part] for part in name.split(' x ')) for name in names]
    panels[0].set_yticks(places, labels)
    return figure


def draw_picture(marginals: Sequence[Marginal]) -> Figure:
    """Return where the draws nearest to the paper's picture lie among all drawn ones."""
    figure, axes = _sheet("Which parameters make the paper's picture?", 5.6)
    shown = marginals[:MOST_SHOWN]
    for place, row in zip(range(len(shown))[::-1], shown):
        low, median, high = (100 * share for share in row.shares)
        is_sure = row.p_value < 0.05
        colour = style.KNOWN['mpcc'] if is_sure else style.QUIET
        axes.plot([low, high], [place, place], color=colour, lw=5, solid_capstyle='butt')
        axes.plot(median, place, 'o', color=style.INK, ms=5)
        axes.annotate(f'{row.posterior[1]:.3g}', (101, place), va='center', annotation_clip=False)
    axes.axvspan(25, 75, **SHADE)
    axes.set_yticks(range(len(shown))[::-1], [row.name.replace('_', ' ') for row in shown])
    axes.set(xlim=(0, 100), ylim=(-0.6, len(shown) - 0.4))
    axes.set_title('median', loc='right', fontsize=8)
    axes.set_xlabel(
        'middle half of the nearest draws, as percentiles of all draws\n'
        '(shaded: middle half of all; grey: no difference beyond chance)'
    )
    return figure


def draw_exchange(explained: Exchange) -> Figure:
    """Return where both cars drive in a task, and what each exchange does to the MPCC's plan."""
    title = f'A task that only the {LABELS[explained.avoids]} avoids'
    figure, (road, wheel, plan) = _sheet(title, 7.4, 3)
    scn = explained.scn
    for side in (scn.edges.left, scn.edges.right):
        road.plot(*side.T, color=style.EDGE, lw=1.2)
    road.plot(scn.reference.X, scn.reference.Y, color=style.QUIET, ls='--', label='coarse path')
    for obstacle in scn.obstacles.items:
        for disc in obstacle.discs():
            road.add_patch(Circle((disc.X, disc.Y), disc.r_obs, color=style.EDGE, alpha=0.6, lw=0))
    for arm, path in explained.driven.items():
        look = {'color': style.KNOWN[arm], 'label': LABELS[arm]}
        road.plot(path.X, path.Y, **look)
        wheel.plot(path.X, np.degrees(path.delta), **look)
        if arm != explained.avoids:
            road.plot(path.X[-1], path.Y[-1], 'x', color=style.KNOWN[arm], ms=9, mew=2)
    road.set(ylabel='Y [m]', title='Path of the centre of gravity (cross: has failed)')
    road.legend(loc='best')
    wheel.set(ylabel='angle [deg]', title='Steering of the front wheels')
    sizes = explained.sizes()
    colours = (*style.OTHERS[: len(sizes) - 3], style.QUIET, style.KNOWN['frenet'], style.INK)
    labels = {ALL: 'all four parts', WEIGHTS: "baseline's weights", BOTH: 'parts and weights'}
    labels |= FACTOR_LABELS
    X = explained.driven['mpcc'].X
    for name, colour in zip(sizes, colours, strict=True):
        label = f'{labels[name]}: rms {sizes[name]:.2f} m'
        plan.plot(X, explained.shifts[name], color=colour, label=label, lw=1.4)
    plan.axhline(0.0, color=style.REFERENCE, lw=1)
    plan.set(ylabel='shift to the left [m]', xlabel='X [m]')
    plan.set_title(f"The MPCC's plan {AHEAD_S:g} s ahead, with a part of the baseline")
    plan.set_xlim(X[0] - 2, max(path.X[-1] for path in explained.driven.values()) + 2)
    figure.legend(*plan.get_legend_handles_labels(), loc='outside lower center', ncols=2)
    return figure


def draw_searches(trials: pd.DataFrame) -> Figure:
    """Return the cost of what every search recommends, over its drives."""
    arms = [name for name in LABELS if name in set(trials['arm'])]
    figure, panels = _sheet('What does more search bring?', 3.2, 1, len(arms))
    panels = np.atleast_1d(panels)
    for axes, arm in zip(panels, arms):
        recommended = trials[(trials['arm'] == arm) & trials['is_recommended']]
        colour = style.assign_colours(arms)[arm]
        for _, search in recommended.groupby('replicate'):
            axes.plot(search['drives'], search['cost'], color=colour, lw=0.9)
        axes.set_title(LABELS[arm].replace(' with', '\nwith'), fontsize=9)
        axes.set(xlabel='drives of the search', xlim=(0, None))
        axes.sharey(panels[0])
    panels[0].set(ylabel='estimated cost of\nwhat is recommended', ylim=(0, None))
    return figure


def _sheet(title, height, rows=1, columns=1):
    """Return a figure as wide as all others, `height` [inch], and its panels."""
    figure = Figure(figsize=(WIDTH_INCH, height), layout='constrained')
    figure.suptitle(title, x=0.012, ha='left', fontsize=11.5, fontweight='bold')
    return figure, figure.subplots(rows, columns, sharex=rows > 1)


def _bars(rows, factor):
    """Return the means (n,) and the lengths (2, n) of their intervals to both sides."""
    low, mean, high = (
        factor * np.array([getattr(row.estimate, name) for row in rows])
        for name in ('low', 'mean', 'high')
    )
    return mean, np.nan_to_num(np.maximum(0.0, [mean - low, high - mean]))


def _select(rows, groups, **fields):
    """Return the rows of each group with these fields, in the order of the groups."""
    chosen = [row for row in rows if all(getattr(row, k) == v for k, v in fields.items())]
    return [row for group in groups for row in chosen if row.group == group]


def _points(axes, places, rows, factor=1, across=False, **look):
    """Draw estimates with their intervals, upwards or across."""
    means, errors = _bars(rows, factor)
    usual = {'color': style.INK, 'marker': 'o', 'ms': 4.5, 'capsize': 2.5, 'lw': 1.3, 'ls': ''}
    if across:
        axes.errorbar(means, places, xerr=errors, **usual | look)
    else:
        axes.errorbar(places, means, yerr=errors, **usual | look)
