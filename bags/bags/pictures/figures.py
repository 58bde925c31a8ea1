"""Figures of a comparison, from drives only: one sheet with every panel, and each panel singly."""

import string

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bags.pictures import palette, panels, road

SHEET_WIDTH = 15.0  # inch
PANEL_SIZE = (7.0, 4.2)  # inch
MIDDLE_ROW = (panels.v2e, panels.v2o, panels.velocity)
LAST_ROW = (panels.sideslip, panels.steer, panels.force, panels.gg)
WITH_AREAS = {road.trajectories, panels.v2e, panels.v2o}
NAMES = {
    road.trajectories: 'trajectories',
    panels.v2e: 'v2e',
    panels.v2o: 'v2o',
    panels.velocity: 'velocity',
    panels.sideslip: 'sideslip',
    panels.steer: 'road_wheel_angle',
    panels.force: 'longitudinal_force',
    panels.gg: 'gg',
}


def write(runs, title, folder):
    """Write the sheet and each panel into `folder` as PNG and SVG; return the paths written."""
    folder.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context(palette.RC):
        written = save(_sheet(runs, title), folder / 'comparison')
        for panel, name in NAMES.items():
            written += save(_single(panel, runs), folder / name)
    return written


def _sheet(runs, title):
    top = min(max(SHEET_WIDTH * road.shape(runs) + 0.5, 2.4), 8.0)
    figure = Figure(figsize=(SHEET_WIDTH, top + 8.6), layout='constrained')
    figure.get_layout_engine().set(w_pad=0.12, h_pad=0.12)
    grid = figure.add_gridspec(3, 12, height_ratios=[top, 3.3, 3.3])
    road.trajectories(figure.add_subplot(grid[0, :]), runs)
    for row, drawn in ((1, MIDDLE_ROW), (2, LAST_ROW)):
        width = 12 // len(drawn)
        for k, panel in enumerate(drawn):
            panel(figure.add_subplot(grid[row, k * width : (k + 1) * width]), runs)
    letter(figure)
    figure.suptitle(title, x=0.012, ha='left', fontsize=14, fontweight='bold')
    _legend(figure, runs, (road.trajectories, panels.v2e))
    return figure


def _single(panel, runs):
    size = PANEL_SIZE
    if panel is road.trajectories:
        size = (SHEET_WIDTH, min(max(SHEET_WIDTH * road.shape(runs) + 1.2, 3.0), SHEET_WIDTH))
    figure = Figure(figsize=size, layout='constrained')
    panel(figure.add_subplot(), runs)
    _legend(figure, runs, (panel,))
    return figure


def _legend(figure, runs, drawn):
    """Name every run once, and the marks that the panels have, above them."""
    keys = [Line2D([], [], label=run.name, lw=2.4, **run.line) for run in runs]
    if road.trajectories in drawn:
        look = {'color': palette.REFERENCE, 'lw': 1.0, 'ls': (0, (6, 3))}
        keys.append(Line2D([], [], label='coarse path', **look))
    if not WITH_AREAS.isdisjoint(drawn):
        for colour, label in ((palette.UNSAFE, 'unsafe area'), (palette.COLLISION, 'collision')):
            keys.append(Line2D([], [], color=colour, lw=7, alpha=0.35, label=label))
    figure.legend(handles=keys, loc='outside upper right', ncols=len(keys), handlelength=2.2)


def letter(figure):
    """Put a letter before the title of every panel, in the order of drawing."""
    for name, ax in zip(string.ascii_lowercase, figure.axes):
        ax.set_title(f'({name}) {ax.get_title(loc="left")}')


def save(figure, stem):
    """Write a figure as <stem>.png and .svg; return both paths."""
    FigureCanvasAgg(figure)
    paths = [stem.with_suffix('.png'), stem.with_suffix('.svg')]
    figure.savefig(paths[0])
    # the layout is found; finding it again is half of the time
    figure.set_layout_engine('none')
    figure.savefig(paths[1], metadata={'Date': None})
    return paths
