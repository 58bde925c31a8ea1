"""Figures of a table of drives: a metric over one column, over two, and as a success surface.

A success surface is the share in which a condition holds, as a smooth function of two columns.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import pandas
from matplotlib.figure import Figure

from bags.errors import BagError
from bags.figures import style
from experiments import drive_table
from experiments.drive_table import DriveTable
from experiments.statistical_inference import CONFIDENCE

COLOURS = 'RdYlBu'  # of shares: red fails, blue holds
OTHER_COLOURS = 'cividis'
CONTOURS = (0.1, 0.5, 0.9)
SURE = 0.9  # share; where the lower bound reaches it, the condition holds for sure
PANEL = (4.6, 3.9)  # inch
DARK = 0.42  # luminance below which numbers are white
# of a success surface
DEGREES = (1, 2, 3)
FOLDS = 5
RESAMPLES, SEED = 200, 0
GRID = 61  # points per column
PENALTY = 10.0  # inverse strength: weak, but holds where the two outcomes can be separated
LEAST = 20  # drives


def write_marginal(
    table: DriveTable, metric: str, column: str, stem: Path, bins: int = drive_table.BINS
) -> list[Path]:
    """Write a metric over one column, a line per controller; return the paths of PNG and SVG.

    Shares have their interval of 95 %, numbers the range from the 5th to the 95th percentile, and
    darker from the 25th to the 75th.
    """
    parts = drive_table.by_controller(table)
    colours = style.assign_colours(list(parts))
    with mpl.rc_context(style.RC):
        figure = Figure(figsize=(6.4, 4.2), layout='constrained')
        axes = figure.subplots()
        is_share, ticks = False, {}
        for k, (name, part) in enumerate(parts.items()):
            summary = drive_table.summarise(part, metric, [column], bins)
            places = _places(summary[column], ticks)
            is_share = 'share' in summary
            places = places + (k - (len(parts) - 1) / 2) * 0.012 * np.ptp(places)
            look = {'color': colours[name], 'marker': 'o', 'ms': 4, 'label': str(name)}
            if is_share:
                errors = [summary['share'] - summary['low'], summary['high'] - summary['share']]
                axes.errorbar(places, summary['share'], errors, capsize=3, **look)
            else:
                _draw_numbers(axes, places, summary, look, with_areas=not ticks)
        if ticks:
            axes.set_xticks(list(ticks.values()), list(map(drive_table.level_text, ticks)))
            axes.set_xlim(-0.5, len(ticks) - 0.5)
        axes.set_xlabel(column)
        axes.set_ylabel(f'share of drives: {metric}' if is_share else metric)
        if is_share:
            axes.set_ylim(-0.03, 1.03)
        if [*parts] != ['']:
            figure.legend(loc='outside upper right', ncols=len(parts))
        return style.save_figure(figure, stem)


def _places(levels, ticks):
    """Return where the groups are on the axis; words are counted in `ticks`."""
    try:
        middles = (v.mid if isinstance(v, pandas.Interval) else v for v in levels)
        return np.array([float(middle) for middle in middles])
    except (ValueError, TypeError):
        return np.array([ticks.setdefault(level, len(ticks)) for level in levels], dtype=float)


def _draw_numbers(axes, places, summary, look, with_areas):
    """Draw medians and quantiles: as areas on an axis of numbers, elsewhere as bars."""
    for low, high, strength, width in (('q05', 'q95', 0.12, 1.2), ('q25', 'q75', 0.22, 5.0)):
        ends = places, summary[low], summary[high]
        if with_areas:
            axes.fill_between(*ends, color=look['color'], alpha=strength, lw=0)
        else:
            axes.vlines(*ends, color=look['color'], lw=width, alpha=0.5 if width > 2 else 1.0)
    axes.plot(places, summary['median'], ls='-' if with_areas else '', **look)


def write_map(
    table: DriveTable,
    metric: str,
    columns: tuple[str, str],
    stem: Path,
    bins: int = drive_table.BINS,
) -> list[Path]:
    """Write a metric over two columns, a panel per controller; return the paths of PNG and SVG.

    Cells are the groups of `drive_table.levels`, of the whole table; each shows its share or
    median, and the number of its drives.
    """
    for name in columns:  # the cells of all panels are the same
        values = table.column(name, '--by')
        table = table._replace(rows=table.rows.assign(**{name: drive_table.levels(values, bins)}))
    summary = drive_table.summarise(table, metric, columns)
    quantity = 'share' if 'share' in summary else 'median'
    low, high = 0.0, 1.0
    if quantity == 'median' and summary[quantity].notna().any():
        low, high = summary[quantity].min(), summary[quantity].max()

    def draw(axes, part, _):
        cells = drive_table.summarise(part, metric, columns).pivot(
            index=columns[1], columns=columns[0], values=[quantity, 'drives']
        )
        values = cells[quantity].to_numpy(dtype=float)
        colours = mpl.colormaps[COLOURS if quantity == 'share' else OTHER_COLOURS]
        known = np.ma.masked_invalid(values)
        ends = {'vmin': low, 'vmax': high, 'origin': 'lower', 'aspect': 'auto'}
        image = axes.imshow(known, colours, **ends)
        for (row, column), value in np.ndenumerate(values):
            if np.isfinite(value):
                text = f'{value:.2g}\n({cells["drives"].iat[row, column]:.0f})'
                red, green, blue, _ = image.cmap(image.norm(value))
                ink = 'white' if 0.299 * red + 0.587 * green + 0.114 * blue < DARK else style.INK
                axes.text(column, row, text, ha='center', va='center', color=ink, fontsize=7.5)
        across, up = (
            list(map(drive_table.level_text, labels))
            for labels in (cells[quantity].columns, cells.index)
        )
        axes.set_xticks(range(len(across)), across, rotation=30, ha='right')
        axes.set_yticks(range(len(up)), up)
        axes.grid(False)
        return image

    title = f'share of drives: {metric}' if quantity == 'share' else f'{metric}, median'
    return _panels(table, columns, title, draw, stem)


def write_surface(
    table: DriveTable, metric: str, columns: tuple[str, str], stem: Path
) -> list[Path]:
    """Write the success surface of a metric over two columns of numbers, a panel per controller.

    Colours and black contours are the fitted share; a dashed contour is where the lower bound of
    its interval of 95 % is 0.9. Dots are the drives, white where the metric is false. A controller
    whose drives nearly all agree has no surface. Raises BagError for a metric that is not true or
    false, for columns without numbers, and where no controller has a surface.
    """
    if table.metric(metric).dtype != 'boolean':
        raise BagError(f'--metric {metric}: a surface needs a metric that is true or false')
    for name in columns:
        if not pandas.api.types.is_numeric_dtype(table.column(name, '--by')):
            raise BagError(f'--by {name}: a surface needs numbers')

    faults = []

    def draw(axes, part, name):
        x, y = (part.rows[column].to_numpy(dtype=float) for column in columns)
        values = part.metric(metric)
        known = values.notna().to_numpy() & np.isfinite(x) & np.isfinite(y)
        x, y, holds = x[known], y[known], values[known].to_numpy(dtype=bool)
        units = part.units(part.rows)[known].tolist()
        try:
            surface = fit_surface(x, y, holds, units)
        except BagError as error:
            # no surface, but the drives are there to be seen
            faults.append(f'{name}: {error}'.removeprefix(': '))
            note = f'{holds.sum()} of {holds.size}, no surface'
        else:
            note = f'{holds.sum()} of {holds.size}, skill {surface.skill:.2f}'
            grid = (surface.x, surface.y)
            axes.pcolormesh(*grid, surface.share, cmap=COLOURS, vmin=0, vmax=1, rasterized=True)
            lines = axes.contour(*grid, surface.share, CONTOURS, colors='k', linewidths=1.0)
            axes.clabel(lines, fmt='%g', fontsize=8)
            if surface.low.max() > SURE > surface.low.min():
                dashed = {'colors': 'k', 'linestyles': '--', 'linewidths': 1.4}
                axes.contour(*grid, surface.low, [SURE], **dashed)
        axes.plot(x[holds], y[holds], 'o', ms=3.0, mfc=style.INK, mec='white', mew=0.4)
        axes.plot(x[~holds], y[~holds], 'o', ms=3.4, mfc='white', mec=style.INK, mew=0.6)
        axes.set_title(f'{axes.get_title(loc="left")} ({note})'.lstrip())
        axes.grid(False)
        return mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, 1.0), COLOURS)

    paths = _panels(table, columns, f'share of drives: {metric}', draw, stem)
    if len(faults) == len(drive_table.by_controller(table)):
        for path in paths:
            path.unlink()
        raise BagError('; '.join(faults))
    return paths


def _panels(
    table: DriveTable, columns: Sequence[str], title: str, draw: Callable, stem: Path
) -> list[Path]:
    parts = drive_table.by_controller(table)
    with mpl.rc_context(style.RC):
        size = (PANEL[0] * len(parts) + 0.9, PANEL[1])
        figure = Figure(figsize=size, layout='constrained')
        grid = figure.subplots(1, len(parts), squeeze=False, sharex=True, sharey=True)[0]
        for axes, (name, part) in zip(grid, parts.items()):
            axes.set_title(str(name))
            axes.set_xlabel(columns[0])
            image = draw(axes, part, name)
        grid[0].set_ylabel(columns[1])
        figure.colorbar(image, ax=grid, label=title)
        return style.save_figure(figure, stem)


class Surface(NamedTuple):
    """A share over a grid; rows are the second column, columns the first."""

    x: np.ndarray  # (GRID,)
    y: np.ndarray  # (GRID,)
    share: np.ndarray  # (GRID, GRID)
    low: np.ndarray  # likewise, of the interval
    high: np.ndarray
    degree: int
    skill: float  # share of the log loss of a constant that is gained on unseen drives, at most 1


def fit_surface(x: np.ndarray, y: np.ndarray, holds: np.ndarray, units: Sequence) -> Surface:
    """Return the surface of truths at points; drives of one unit are resampled together.

    Logistic regression on polynomials of the two columns, of the degree that predicts drives best
    that it was not fitted to (cross-validation, log loss). The interval is that of the bootstrap,
    resampled by draw: it holds for the form that was fitted, not for what a polynomial cannot
    follow.

    Raises BagError for fewer than 20 drives or two units, and where the condition holds, or fails,
    in all but a few: there is nothing to fit.
    """
    points, holds = np.column_stack([x, y]).astype(float), np.asarray(holds, bool)
    codes = np.unique(np.asarray([str(unit) for unit in units]), return_inverse=True)[1]
    rarest = min(holds.sum(), len(holds) - holds.sum())
    if len(holds) < LEAST or rarest < FOLDS:
        raise BagError(
            f'{holds.sum()} of {len(holds)} drives fulfil the condition; a surface needs '
            f'{LEAST} drives, and {FOLDS} that do and that do not'
        )
    if codes.max() < 1:
        raise BagError('the drives share one draw or run; a surface needs at least two')
    skills = [_skill(points, holds, codes, degree) for degree in DEGREES]
    degree = DEGREES[int(np.argmax(skills))]
    axes = [np.linspace(column.min(), column.max(), GRID) for column in points.T]
    grid = np.column_stack([part.ravel() for part in np.meshgrid(*axes)])
    share = _fit(points, holds, degree).predict_proba(grid)[:, 1]
    low, high = _interval(points, holds, codes, degree, grid)
    shaped = (part.reshape(GRID, GRID) for part in (share, low, high))
    return Surface(*axes, *shaped, degree, max(skills))


def _fit(points, holds, degree):
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import PolynomialFeatures, StandardScaler

    model = make_pipeline(
        StandardScaler(),
        PolynomialFeatures(degree, include_bias=False),
        LogisticRegression(C=PENALTY, max_iter=1000),
    )
    return model.fit(points, holds)


def _skill(points, holds, codes, degree):
    """Return how much of the log loss of the mean is gained on drives that were left out."""
    from sklearn.metrics import log_loss
    from sklearn.model_selection import GroupKFold

    predicted, constant = np.empty(len(holds)), np.empty(len(holds))
    folds = GroupKFold(min(FOLDS, len(np.unique(codes)))).split(points, holds, codes)
    for rest, left_out in folds:
        constant[left_out] = np.clip(holds[rest].mean(), 1e-3, 1 - 1e-3)
        if np.unique(holds[rest]).size < 2:
            predicted[left_out] = constant[left_out]
            continue
        model = _fit(points[rest], holds[rest], degree)
        predicted[left_out] = model.predict_proba(points[left_out])[:, 1]
    return 1.0 - log_loss(holds, predicted) / log_loss(holds, constant)


def _interval(points, holds, codes, degree, grid):
    rng = np.random.default_rng(SEED)
    members = [np.flatnonzero(codes == code) for code in range(codes.max() + 1)]
    shares = []
    while len(shares) < RESAMPLES:
        chosen = rng.integers(len(members), size=len(members))
        rows = np.concatenate([members[code] for code in chosen])
        if np.unique(holds[rows]).size == 2:
            shares.append(_fit(points[rows], holds[rows], degree).predict_proba(grid)[:, 1])
    tail = 100 * (1 - CONFIDENCE) / 2
    return np.percentile(shares, [tail, 100 - tail], axis=0)
