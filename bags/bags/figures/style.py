"""The style of every figure: colours for colour-blind readers, fonts, grid; saving a figure."""

import string
from pathlib import Path

# Okabe and Ito, "Color universal design"; a controller keeps its colour in every figure
KNOWN = {'mpcc': '#0072B2', 'mpcc_no_ca': '#4D4D4D', 'frenet': '#D55E00'}
OTHERS = ('#009E73', '#CC79A7', '#E69F00', '#56B4E9', '#000000')
DASHED = (0, (5, 1.5))
TUNED = '_tuned'  # suffix of a tuned controller, which is drawn like the untuned one

INK = '#262626'
QUIET = '#6F6F6F'
EDGE = '#404040'
REFERENCE = '#8C8C8C'
UNSAFE = '#E69F00'
COLLISION = '#CC3311'

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
    """Return {controller: colour}; unknown names share OTHERS in the order given.

    A tuned controller has the colour of the untuned one, unless both are shown.
    """
    spare = iter(OTHERS * len(names))
    result = {}
    for name in names:
        plain = name.removesuffix(TUNED)
        known = plain in KNOWN and (plain == name or plain not in names)
        result[name] = KNOWN[plain] if known else next(spare)
    return result


def line_style(name):
    """Return the line style of a controller."""
    return DASHED if name.removesuffix(TUNED) == 'mpcc_no_ca' else '-'


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


def figure_paths(stem: Path) -> list[Path]:
    """Return <stem>.png and <stem>.svg, also where the stem has a dot."""
    return [stem.with_name(f'{stem.name}{suffix}') for suffix in ('.png', '.svg')]


def save_figure(figure, stem: Path) -> list[Path]:
    """Write a figure with a layout engine as <stem>.png and .svg; return both paths."""
    # nodes use the colours: they need not load matplotlib
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(figure)
    # savefig would draw a figure with a layout engine twice per file, the first time for nothing
    figure.dpi = mpl.rcParams['savefig.dpi']
    figure.get_layout_engine().execute(figure)
    figure.set_layout_engine(None)
    paths = figure_paths(stem)
    figure.savefig(paths[0])
    figure.savefig(paths[1], metadata={'Date': None})
    return paths
