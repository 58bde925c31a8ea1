"""One look for every figure: colours that stay apart for colour-blind readers, type, grid."""

# Okabe and Ito, "Color universal design"; a controller keeps its colour in every figure
KNOWN = {'mpcc': '#0072B2', 'mpcc_no_ca': '#4D4D4D', 'frenet': '#D55E00'}
OTHERS = ('#009E73', '#CC79A7', '#E69F00', '#56B4E9', '#000000')
DASHED = (0, (5, 1.5))
KNOWN_DASHES = {'mpcc_no_ca': DASHED}
TUNED = '_tuned'  # ends the name of a controller that looks like the one it was tuned from

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
    # the same run gives the same file
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
    found = {}
    for name in names:
        plain = name.removesuffix(TUNED)
        known = plain in KNOWN and (plain == name or plain not in names)
        found[name] = KNOWN[plain] if known else next(spare)
    return found


def line_style(name):
    """Return the line style of a controller."""
    return KNOWN_DASHES.get(name.removesuffix(TUNED), '-')
