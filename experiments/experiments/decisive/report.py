"""What the rows of the study say: text and tables, and a figure for each estimand."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
from rich.console import Console

from bags.command_line import print_paths, print_text
from bags.figures import style
from experiments.decisive import analysis, exchange, figures, picture, run
from experiments.families.lane_change_task import DEMAND

TEXT = 'decided.txt'


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


def at_ends(plan: Mapping[str, Any], tuned: pd.DataFrame, arm: str) -> str:
    """Return how many searches of an arm chose an end of a range, in all and by weight."""
    own = tuned[tuned['arm'] == arm].dropna(axis=1)
    ranges = {name: ends for name, ends in plan['search']['ranges'].items() if name in own}
    at = pd.DataFrame({name: own[name].isin(ends) for name, ends in ranges.items()})
    shown = ', '.join(f'{name} {count}' for name, count in at.sum().items() if count)
    return f'{at.any(axis=1).sum()} of {len(at)} ({shown})'


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
        lines.append(
            f'  searches that chose an end of a range: {at_ends(plan, tables["tuned"], arm)}'
        )
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
    paths = figures.write_all(results, tables['trials'], marginals, plan, DEMAND, out / 'figures')
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
        paths = style.save_figure(figures.draw_exchange(exchanged), folder / 'exchange')
    print_paths(console, {'figure': paths[0]})
