"""The figures of a comparison of runs, as matplotlib figures that a notebook shows."""

import io
from collections.abc import Mapping
from typing import Protocol

import matplotlib as mpl
from matplotlib.figure import Figure

from bags.errors import BagError
from bags.evaluation.drive import Drive
from bags.evaluation.series import Series
from bags.figures import comparison_figures, panels, style
from msgs_yaml.strict_yaml import closest


class Evaluated(Protocol):
    """What is drawn of a run."""

    scenario: str
    drive: Drive
    series: Series


def drawn_runs(runs: Mapping[str, Evaluated]) -> list[panels.Run]:
    """Return runs by label as the figures take them, each with its look.

    Raises BagError for runs of different scenarios: there is one road in a figure.
    """
    scenarios = list(dict.fromkeys(run.scenario for run in runs.values()))
    if len(scenarios) > 1:
        listed = ', '.join(map(repr, scenarios))
        raise BagError(f'a figure shows one scenario, the runs drove {listed}: choose runs of one')
    controllers = [panels.controller_of(run.drive) for run in runs.values()]
    looks = style.assign_looks(list(runs), controllers)
    return [panels.Run(name, r.drive, r.series, looks[name]) for name, r in runs.items()]


def draw(runs: Mapping[str, Evaluated], name: str) -> Figure:
    """Return a figure of `comparison_figures.ALL` of runs by label. Raises BagError."""
    if name not in comparison_figures.ALL:
        known = comparison_figures.ALL
        raise BagError(f'no figure {name!r}{closest(name, known)}; there are {", ".join(known)}')
    drawn = drawn_runs(runs)
    with mpl.rc_context(style.RC):
        figure = comparison_figures.draw_figure(name, drawn, drawn[0].drive.facts.scenario)
        # ticks take their look from the style when they are first laid out
        figure.draw_without_rendering()
        style.hide_overlapping(figure, style.TIME_LABEL)
    return _shown_in_notebooks(figure)


def _shown_in_notebooks(figure):
    """Return the figure with what a notebook shows of it, also where pyplot was never imported."""

    def as_png():
        stream = io.BytesIO()
        figure.savefig(stream, format='png')
        return stream.getvalue()

    figure._repr_png_ = as_png
    return figure
