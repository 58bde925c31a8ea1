"""Who survived: shares with intervals per family and controller, and why the others did not."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas
from rich.table import Table

from experiments import console
from experiments.statistical_inference import wilson_interval

ALL = 'all'
ENTRIES = 'entries'  # stands where a family does

Rows = Sequence[Mapping[str, Any]]


def family_of(row: Mapping[str, Any]) -> str:
    """Return the family of a row, ENTRIES for one that is no draw."""
    return row['family'] or ENTRIES


def counts(rows: Rows) -> dict[tuple[str, str], tuple[int, int]]:
    """Return how many drives survived, and how many have a result, by family and controller.

    Of several families also that of ALL of them.
    """
    kept = ('controller', 'survived', 'error')
    frame = pandas.DataFrame(
        [{'family': family_of(row)} | {n: row[n] for n in kept} for row in rows],
        columns=('family', *kept),
    )
    if frame['family'].nunique() > 1:
        frame = pandas.concat([frame, frame.assign(family=ALL)])
    frame['driven'] = ~frame['error'].astype(bool)
    frame['survived'] = frame['survived'].eq(True) & frame['driven']
    sums = frame.groupby(['family', 'controller'], sort=False)[['survived', 'driven']].sum()
    return {pair: (int(survived), int(driven)) for pair, survived, driven in sums.itertuples()}


def build_table(rows: Rows) -> Table:
    """Return survived of driven per family and controller, with Wilson's interval of 95 %."""
    by_pair = counts(rows)
    families, controllers = (list(dict.fromkeys(pair[k] for pair in by_pair)) for k in (0, 1))
    rows = [
        [family, *(share_cell(*by_pair.get((family, name), (0, 0))) for name in controllers)]
        for family in families
    ]
    return console.table(['survived', *controllers], rows)


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
    return [
        f'{controller} in {family}: {survived}/{driven}'
        for (family, controller), (survived, driven) in counts(rows).items()
        if family != ALL and driven and survived < share * driven
    ]
