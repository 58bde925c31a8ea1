"""What a scenario expects of a run (`expect:`) against the metrics of that run."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from rich.table import Table

from bags.command_line import table
from bags.errors import BagError
from bags.evaluation.metrics import METRICS
from bags.evaluation.metrics.registry import flatten
from msgs_yaml.strict_yaml import closest
from scenario_publisher.expectations import Expectation, Expectations


class Outcome(NamedTuple):
    """One expectation and what was measured."""

    expectation: Expectation
    measured: bool | float | None

    @property
    def is_met(self) -> bool:
        """Whether the measured value is as expected."""
        return self.expectation.is_met_by(self.measured)


def check_names(expect: Expectations, source: str) -> None:
    """Raise BagError for an expectation of a metric that does not exist."""
    for expectation in expect:
        name = expectation.metric.partition('.')[0]
        if name not in METRICS:
            hint = closest(name, METRICS)
            raise BagError(
                f'{source}: expect.{expectation.metric}: no such metric{hint}; '
                '`bags compare --list-metrics` lists them'
            )


def judge(expect: Expectations, metrics: Mapping[str, Any]) -> list[Outcome]:
    """Return every expectation with its measured value; `metrics` may be nested or flat.

    A metric that the run does not have is None: it meets nothing.
    """
    flat = flatten(dict(metrics))
    return [Outcome(expectation, flat.get(expectation.metric)) for expectation in expect]


def build_table(outcomes: Sequence[tuple[str, Outcome]]) -> Table:
    """Return a table of (name of the run, outcome)."""
    words, rows = {True: 'yes', False: 'no', None: '–'}, []
    for run, outcome in outcomes:
        expectation = outcome.expectation
        verdict = '[green]as expected[/]' if outcome.is_met else '[bold red]NOT MET[/]'
        value = outcome.measured
        text = words[value] if isinstance(value, bool | None) else f'{value:.3g}'
        rows.append((run, expectation.metric, expectation.describe(), text, verdict))
    columns = ('run', 'expected', '', 'measured', '')
    return table(columns, rows, left=columns, overflow='fold')
