"""Who survived: shares with intervals per family and controller, and why the others did not."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.table import Table

from experiments.statistical_inference import wilson_interval

ALL = 'all'
ENTRIES = 'entries'  # stands where a family does

Rows = Sequence[Mapping[str, Any]]


def family_of(row: Mapping[str, Any]) -> str:
    """Return the family of a row, ENTRIES for one that is no draw."""
    return row['family'] or ENTRIES


def count(rows: Rows, family: str, controller: str) -> tuple[int, int]:
    """Return how many drives survived, and how many there are that have a result."""
    judged = [
        row
        for row in rows
        if row['controller'] == controller and family in (ALL, family_of(row)) and not row['error']
    ]
    return sum(row['survived'] is True for row in judged), len(judged)


def build_table(rows: Rows) -> Table:
    """Return survived of driven per family and controller, with Wilson's interval of 95 %."""
    controllers = list(dict.fromkeys(row['controller'] for row in rows))
    families = list(dict.fromkeys(map(family_of, rows)))
    table = Table(box=None, padding=(0, 2, 0, 0))
    table.add_column('survived')
    for controller in controllers:
        table.add_column(controller, justify='right')
    for family in [*families, ALL] if len(families) > 1 else families:
        cells = (share_cell(*count(rows, family, controller)) for controller in controllers)
        table.add_row(family, *cells)
    return table


def share_cell(survived: int, driven: int, digits: int = 1) -> str:
    """Return `survived/driven share (interval)` with so many digits of the share, in percent."""
    if not driven:
        return '–'
    low, high = (100 * bound for bound in wilson_interval(survived, driven))
    return f'{survived}/{driven} {survived / driven:.{digits}%} [dim]({low:.0f}–{high:.0f})[/]'


def describe_losses(rows: Rows) -> Iterator[str]:
    """Yield a line for each drive that was lost or failed: which, by whom, and the cause."""
    for row in rows:
        if row['error']:
            yield f'{row["scenario"]} {row["controller"]}: no result: {row["error"]}'
        elif row['survived'] is not True:
            yield f'{row["scenario"]} {row["controller"]}: {row["lost_by"]} ({row["verdict"]})'


def families_below(rows: Rows, share: float) -> list[str]:
    """Return a text for each family and controller that survived less than a share."""
    pairs = dict.fromkeys((family_of(row), row['controller']) for row in rows)
    counts = (
        (family, controller, *count(rows, family, controller)) for family, controller in pairs
    )
    return [
        f'{controller} in {family}: {survived}/{driven}'
        for family, controller, survived, driven in counts
        if driven and survived < share * driven
    ]
