"""The metrics of a run by name, with their units and meanings, as a read-only mapping."""

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from bags.analysis import frames
from bags.errors import BagError
from bags.evaluation.flattening import flatten
from bags.evaluation.metrics import METRICS, VERDICT
from bags.report import metrics_table
from msgs_yaml.strict_yaml import closest

if TYPE_CHECKING:
    import pandas as pd

VERDICT_MEANING = 'How the run ended, in words.'


class MetricValues(Mapping[str, Any]):
    """The metrics of one run: `metrics['min_v2o_m']` is what comparison.json has under this name.

    A metric that has no meaning in the run is None. A member of a dictionary or a list is found by
    its dotted name, too: `metrics['min_v2o_per_obstacle_m.1']`.
    """

    def __init__(self, values: Mapping[str, Any]):
        self._values = dict(values)

    def __getitem__(self, name: str) -> Any:
        if name in self._values:
            return self._values[name]
        flat = self.flat()
        if name not in flat:
            raise UnknownMetricError(name, [*self._values, *flat])
        return flat[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def unit(self, name: str) -> str:
        """Return the unit of a metric, '' of one without; KeyError for an unknown name."""
        return _described(name, 'unit')

    def meaning(self, name: str) -> str:
        """Return what a metric is, in one sentence or more; KeyError for an unknown name."""
        return _described(name, 'meaning')

    def flat(self) -> dict[str, Any]:
        """Return every single value by dotted name, as the rows of comparison.csv."""
        return flatten(self._values)

    def frame(self) -> 'pd.DataFrame':
        """Return a row per single value: `value`, `unit`, `meaning`. ImportError without pandas."""
        pandas = frames.import_pandas()
        flat = self.flat()
        rows = [(value, self.unit(name), self.meaning(name)) for name, value in flat.items()]
        index = pandas.Index(flat, name='metric')
        return pandas.DataFrame(rows, index=index, columns=['value', 'unit', 'meaning'])

    def __repr__(self) -> str:
        """Return the rows of the printed table, and the verdict."""
        lines = [
            (line.title, line.unit, line.cells[0].text.replace('\n', ', '))
            for line in metrics_table.table_lines({'': self._values})
        ]
        widths = [max(len(line[k]) for line in lines) for k in range(2)]
        rows = (f'{title:<{widths[0]}}  {unit:<{widths[1]}}  {v}' for title, unit, v in lines)
        return '\n'.join((self._values[VERDICT], *rows))


class UnknownMetricError(BagError, KeyError):
    """No metric has this name; the message suggests one."""

    def __init__(self, name: str, known: Iterable[str]):
        super().__init__(f'no metric {name!r}{closest(name, known)}')

    def __str__(self) -> str:
        return self.args[0]


def _described(name, attribute):
    if name == VERDICT:
        return '' if attribute == 'unit' else VERDICT_MEANING
    # a member has the unit of its metric; those of an overshoot both are lengths
    base = name.partition('.')[0]
    if base not in METRICS:
        raise UnknownMetricError(name, [VERDICT, *METRICS])
    return getattr(METRICS[base], attribute)
