"""Several runs, recorded or simulated: one table, one figure, one report.

    import bags

    folder = 'bags/runs/double_lane_change'
    runs = bags.compare(bags.load(f'{folder}/mpcc'), bags.load(f'{folder}/frenet'))
    print(runs)  # the table of `bags compare`
    runs.frame()[['controller', 'min_v2o_m', 'rms_contouring_m']]
    runs.figure('v2o')
    runs.report('out')  # report.html, comparison.json and .csv, figures

`experiments.drive_many` returns the same for a sweep.
"""

import io
import itertools
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, overload

from rich.console import Console

from bags import frames, metrics_table
from bags.errors import BagError
from bags.run import Run, UnknownNameError, load
from msgs_yaml.strict_yaml import closest

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

__all__ = ['Run', 'RunSet', 'compare', 'load']

TABLE_RUNS = 6  # up to so many are printed as a table
MCAP = '.mcap'
WIDTH = 240  # characters of that table at most


class RunSet(Sequence[Run]):
    """Runs in their order, by number, label or slice.

    Labels are unique: of two recordings of `mpcc` the second is called after its folder, `mpcc@1`;
    of two simulations it is `mpcc (2)`.
    """

    def __init__(self, runs: Iterable[Run]):
        self.by_label: dict[str, Run] = {}
        for run in runs:
            folders, path = (), run.path
            if path:
                folders = ((path.parent if path.suffix == MCAP else path).name,)
            numbered = (f'{run.label} ({number})' for number in itertools.count(2))
            names = itertools.chain([run.label], folders, numbered)
            self.by_label[next(name for name in names if name not in self.by_label)] = run

    @overload
    def __getitem__(self, which: int | str) -> Run: ...

    @overload
    def __getitem__(self, which: slice) -> 'RunSet': ...

    def __getitem__(self, which):
        if isinstance(which, str):
            if which not in self.by_label:
                known = ', '.join(map(repr, self.by_label))
                raise UnknownNameError(
                    f'no run {which!r}{closest(which, self.by_label)}; there are {known}'
                )
            return self.by_label[which]
        chosen = [*self.by_label.values()][which]
        return RunSet(chosen) if isinstance(which, slice) else chosen

    def __len__(self) -> int:
        return len(self.by_label)

    def __iter__(self) -> Iterator[Run]:
        return iter(self.by_label.values())

    @property
    def labels(self) -> list[str]:
        """The label of each run."""
        return list(self.by_label)

    def frame(self) -> 'pd.DataFrame':
        """Return a row per run, indexed by label: scenario, controller, settings, single metrics.

        A setting that a run leaves as it is has the value of its parameters there. Raises BagError
        for a run that cannot be evaluated, ImportError without pandas.
        """
        pandas = frames.import_pandas()
        settings = list(dict.fromkeys(name for run in self for name in run.settings))
        rows = [
            {
                'scenario': run.scenario,
                'controller': run.controller,
                **{name: run.settings.get(name, run.parameters.get(name)) for name in settings},
                **run.metrics.flat(),
            }
            for run in self
        ]
        return pandas.DataFrame(rows, index=pandas.Index(self.labels, name='run'))

    def figure(self, name: str = 'comparison') -> 'Figure':
        """Return a figure of the comparison: the sheet of all panels, or one of them.

        Raises BagError for an unknown name, and for runs of different scenarios.
        """
        # matplotlib takes a second to load
        from bags.figures import comparison_figures

        return comparison_figures.draw(self.by_label, name)

    def report(self, folder: str | os.PathLike[str]) -> Path:
        """Write report.html, comparison.json, comparison.csv and figures; return the report.

        Raises BagError for runs of different scenarios.
        """
        from bags.figures import comparison_figures
        from bags.report.comparison import compare_runs

        return compare_runs(comparison_figures.drawn_runs(self.by_label), Path(folder)).report

    def __repr__(self) -> str:
        """Return the table of the metrics; of more than six runs a line each."""
        if not self:
            return 'RunSet(no runs)'
        if len(self) > TABLE_RUNS:
            return '\n'.join((f'RunSet of {len(self)}:', *map(repr, self)))
        scenarios = ', '.join(dict.fromkeys(run.scenario for run in self))
        values = {'scenario': scenarios, 'runs': {n: r.metrics for n, r in self.by_label.items()}}
        values |= metrics_table.drives_of_paper(run.drive for run in self)
        out = io.StringIO()
        # plain text, also where rich would know a notebook or a terminal
        console = Console(file=out, width=WIDTH, color_system=None, force_jupyter=False)
        console.print(metrics_table.build_table(values))
        return '\n'.join(line.rstrip() for line in out.getvalue().splitlines())


def compare(*runs: Run) -> RunSet:
    """Return several runs as one table, figure and report. Raises BagError without any."""
    if not runs:
        raise BagError('compare: no run is given; allowed one or more')
    return RunSet(runs)
