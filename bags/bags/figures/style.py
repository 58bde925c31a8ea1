"""The style of every figure: colours for colour-blind readers, fonts, grid; saving a figure.

Colour and dash tell the run, in every figure and in the report, and nothing else is dashed;
dotted is a curve from a CSV file. Curves that coincide stay visible: what is drawn later is
narrower.
"""

import string
from collections.abc import Mapping, Sequence
from copy import copy
from pathlib import Path
from typing import NamedTuple

from bags.evaluation.metrics.registry import EvaluatedDrive

# Okabe and Ito, "Color universal design"; a controller keeps its colour in every figure
KNOWN = {'mpcc': '#0072B2', 'mpcc_no_ca': '#4D4D4D', 'frenet': '#D55E00'}
OTHERS = ('#009E73', '#CC79A7', '#56B4E9', '#882255', '#000000')
Dash = tuple[float, ...]  # points: drawn, left out, drawn, ...; empty for a solid line
SOLID: Dash = ()
DASHED: Dash = (8.0, 3.0)
DASH_DOT: Dash = (9.0, 2.5, 2.0, 2.5)
DOTTED: Dash = (1.5, 2.5)
KNOWN_DASHES = {'mpcc': SOLID, 'mpcc_no_ca': DASHED, 'frenet': DASH_DOT}
OTHER_DASHES = (SOLID, (5.0, 2.0), DASH_DOT, (14.0, 3.0), (4.0, 2.0, 1.5, 2.0, 1.5, 2.0))
WIDTHS = (3.2, 1.6)  # points, of the first run and of the last one
WIDTH = 1.7  # points, of a single run
MANY = 8  # more runs have no colour of their own: each has that of its controller
MANY_WIDTH = 0.8  # points, of one of them
SUFFIXES = '.png', '.svg'
TIME_LABEL = 'time label'  # gid of texts of which one that covers another is hidden

INK = '#262626'
QUIET = '#6F6F6F'
EDGE = '#404040'
REFERENCE = '#8C8C8C'
COARSE_PATH = '#C7B5E3'
UNSAFE = '#E69F00'
COLLISION = '#CC3311'
AREAS = {UNSAFE: 'within the safety distance', COLLISION: 'circles overlap'}

RC = {
    'axes.axisbelow': True,
    'axes.edgecolor': '#7F7F7F',
    'axes.grid': True,
    'axes.labelcolor': INK,
    'axes.labelsize': 9.5,
    'axes.linewidth': 0.7,
    'axes.spines.right': False,
    'axes.spines.top': False,
    'axes.titlelocation': 'left',
    'axes.titlepad': 7.0,
    'axes.titlesize': 10.5,
    'axes.titleweight': 'bold',
    'figure.facecolor': 'white',
    'font.family': 'DejaVu Sans',
    'font.size': 9.0,
    'grid.color': '#E4E4E4',
    'grid.linewidth': 0.6,
    'legend.fontsize': 8.5,
    'legend.frameon': False,
    'lines.linewidth': 1.7,
    'lines.solid_capstyle': 'round',
    'savefig.dpi': 150,
    'svg.fonttype': 'path',
    # the same run gives identical files
    'svg.hashsalt': 'bags',
    'text.color': INK,
    'xtick.color': '#595959',
    'xtick.labelcolor': INK,
    'ytick.color': '#595959',
    'ytick.labelcolor': INK,
}


def assign_colours(names):
    """Return {controller: colour}; unknown names share OTHERS in the order given."""
    spare = iter(OTHERS * len(names))
    return {name: KNOWN[name] if name in KNOWN else next(spare) for name in names}


class Look(NamedTuple):
    """How the curves of a run are drawn."""

    colour: str
    dash: Dash = SOLID
    width: float = WIDTH  # points

    @property
    def line(self) -> dict:
        """Keyword arguments of `Axes.plot`."""
        # Matplotlib counts dashes in widths of the line
        dash = (0, tuple(part / self.width for part in self.dash)) if self.dash else '-'
        return {'color': self.colour, 'linestyle': dash, 'linewidth': self.width}


def assign_looks(names: Sequence[str], controllers: Sequence[str] = ()) -> dict[str, Look]:
    """Return {run: Look}; a known controller keeps its colour and dash whoever else is shown.

    The widths fall in the order of `names`, which is the order of drawing. Of more than MANY runs
    those of one controller (`controllers`: of each run) share a colour, and all are thin.
    """
    if len(names) > MANY and controllers:
        groups = list(dict.fromkeys(controllers))
        known = assign_colours(groups) if len(groups) <= MANY else dict.fromkeys(groups, QUIET)
        return {
            name: Look(known[group], SOLID, MANY_WIDTH) for name, group in zip(names, controllers)
        }
    colours = assign_colours(names)
    dashes = {name: KNOWN_DASHES[name] for name in names if name in KNOWN_DASHES}
    spare = iter([dash for dash in OTHER_DASHES if dash not in dashes.values()] * len(names))
    first, last = WIDTHS
    looks = {}
    for k, name in enumerate(names):
        dash = dashes[name] if name in dashes else next(spare)
        width = first + (last - first) * k / (len(names) - 1) if len(names) > 1 else WIDTH
        looks[name] = Look(colours[name], dash, width)
    return looks


def assign(runs: Mapping[str, EvaluatedDrive]) -> list[EvaluatedDrive]:
    """Return runs by name in their order, each with this name and its look."""
    looks = assign_looks(list(runs), [_controller(run) for run in runs.values()])
    named = {name: copy(run) for name, run in runs.items()}
    for name, run in named.items():
        run.name, run.look = name, looks[name]
    return list(named.values())


def _controller(run):
    """Return the controller of a run without the label of the variant."""
    return run.drive.facts.controller.partition('@')[0]


def legend_looks(runs: Sequence[EvaluatedDrive]) -> dict[str, Look]:
    """Return {label: Look} of a legend: the runs, or of more than MANY how many share a colour."""
    if len(runs) <= MANY:
        return {run.name: run.look for run in runs}
    groups: dict[Look, list[str]] = {}
    for run in runs:
        groups.setdefault(run.look._replace(width=WIDTH), []).append(_controller(run))
    return {
        f'{names[0]}: {len(names)} runs' if len(set(names)) == 1 else f'{len(names)} runs': look
        for look, names in groups.items()
    }


def coarse_path_line() -> dict:
    """Return the keyword arguments that draw the coarse path: a broad band below the curves."""
    return {'color': COARSE_PATH, 'linewidth': 5.0, 'linestyle': '-', 'zorder': 1}


def hide_overlapping(figure) -> None:
    """Hide those texts with the gid TIME_LABEL that would cover an earlier one.

    The figure must be laid out: the room that a text takes depends on the size of the axes.
    """
    from matplotlib.transforms import Bbox

    for ax in figure.axes:
        taken: list[Bbox] = []
        for text in (label for label in ax.texts if label.get_gid() == TIME_LABEL):
            extent = text.get_window_extent().padded(2.0)
            if any(extent.overlaps(other) for other in taken):
                text.set_visible(False)
            else:
                taken.append(extent)


def new_sheet(size, title):
    """Return a figure for several panels, `size` [inch]."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout='constrained')
    figure.get_layout_engine().set(w_pad=0.12, h_pad=0.12)
    figure.suptitle(title, x=0.012, ha='left', fontsize=14, fontweight='bold')
    return figure


def letter_panels(figure) -> None:
    """Put a letter before the title of every panel, in the order of drawing."""
    for name, ax in zip(string.ascii_lowercase, figure.axes):
        ax.set_title(f'({name}) {ax.get_title(loc="left")}')


def figure_paths(stem: Path, suffixes: Sequence[str] = SUFFIXES) -> list[Path]:
    """Return <stem>.png and <stem>.svg, or those of `suffixes`, also where the stem has a dot."""
    return [stem.with_name(f'{stem.name}{suffix}') for suffix in suffixes]


def save_figure(figure, stem: Path, suffixes: Sequence[str] = SUFFIXES) -> list[Path]:
    """Write a figure with a layout engine as <stem> with each suffix; return the paths."""
    # nodes use the colours: they need not load matplotlib
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    # savefig would draw a figure with a layout engine twice per file, the first time for nothing
    figure.dpi = mpl.rcParams['savefig.dpi']
    figure.get_layout_engine().execute(figure)
    figure.set_layout_engine(None)
    hide_overlapping(figure)
    paths = figure_paths(stem, suffixes)
    for path in paths:
        figure.savefig(path, metadata={'Date': None} if path.suffix == '.svg' else None)
    return paths
