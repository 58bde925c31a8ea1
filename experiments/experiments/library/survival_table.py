"""Who survived: shares with intervals per family and controller, and why the others did not."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.table import Table

from experiments.statistical_inference import wilson_interval

ALL = 'all'

Rows = Sequence[Mapping[str, Any]]


def count(rows: Rows, family: str, controller: str) -> tuple[int, int]:
    """Return how many drives survived, and how many there are that have a result."""
    judged = [
        row
        for row in rows
        if row['controller'] == controller and family in (ALL, row['family']) and not row['error']
    ]
    return sum(row['survived'] is True for row in judged), len(judged)


def build_table(rows: Rows) -> Table:
    """Return survived of driven per family and controller, with Wilson's interval of 95 %."""
    controllers = list(dict.fromkeys(row['controller'] for row in rows))
    families = list(dict.fromkeys(row['family'] for row in rows))
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column('survived')
    for controller in controllers:
        table.add_column(controller, justify='right')
    for family in [*families, ALL] if len(families) > 1 else families:
        cells = (_cell(*count(rows, family, controller)) for controller in controllers)
        table.add_row(family, *cells)
    return table


def _cell(survived, driven):
    if not driven:
        return '–'
    low, high = (100 * bound for bound in wilson_interval(survived, driven))
    share = f'{survived / driven:.1%}'
    return f'{survived}/{driven} {share} [dim]({low:.0f}–{high:.0f})[/]'


def describe_losses(rows: Rows) -> Iterator[str]:
    """Yield a line for each drive that was lost or failed: which, by whom, and the cause."""
    for row in rows:
        if row['error']:
            yield f'{row["drive"]} {row["controller"]}: no result: {row["error"]}'
        elif row['survived'] is not True:
            yield f'{row["drive"]} {row["controller"]}: {row["lost_by"]} ({row["verdict"]})'


def families_below(rows: Rows, share: float) -> list[str]:
    """Return a text for each family and controller that survived less than a share."""
    pairs = dict.fromkeys((row['family'], row['controller']) for row in rows)
    counts = (
        (family, controller, *count(rows, family, controller)) for family, controller in pairs
    )
    return [
        f'{controller} in {family}: {survived}/{driven}'
        for family, controller, survived, driven in counts
        if driven and survived < share * driven
    ]
