"""A check for a person: how much agrees, and the first tick that does not."""

from collections import Counter

from rich.console import Console
from rich.table import Table

from experiments.replay import check
from experiments.replay.check import Compared, Report
from experiments.replay.fields import COMMAND_UNITS, Pair

MOST_FIELDS = 12  # of the first differing tick


def show(report: Report, console: Console) -> None:
    """Print one report."""
    controller, mode = (report.run_info.get(key, 'unknown') for key in ('controller', 'mode'))
    console.print(f'{report.name}: {controller}, {mode}', markup=False, soft_wrap=True)
    failed = report.failures
    many = f'{len(report.ticks)} ticks'
    if report.repeatable < len(report.ticks):
        many = f'{report.repeatable} of {many}, the others cannot be repeated exactly'
    if failed:
        console.print(
            f'  [red]differs[/] in {len(failed)} of {many}; first in tick '
            f'{failed[0].tick.number} at {failed[0].tick.t_s:.2f} s:'
        )
        console.print(_fields(failed[0]))
        rest = len(failed[0].differing) - MOST_FIELDS
        if rest > 0:
            console.print(f'  and {rest} more fields')
    else:
        console.print(f'  [green]the same[/] in {many}')
    for group, (size, tick) in check.largest(report).items():
        at = f' (tick {tick})' if size else ''
        console.print(f'  largest difference, {group}: {size:.1e}{at}', highlight=False)
    causes = Counter(one.gap for one in report.ticks if one.gap)
    if causes:
        console.print('  not repeatable, at or soon after')
    for cause, n in causes.items():
        differ = sum(one.gap == cause for one in report.unproven)
        told = f'    {cause}: {n} ticks, {differ} differ'
        console.print(told, markup=False, highlight=False)


def _fields(one: Compared) -> Table:
    table = Table(box=None, pad_edge=True, padding=(0, 1), header_style='bold')
    table.add_column('field', no_wrap=True)
    for title in ('recorded', 'replayed', 'difference', 'allowed'):
        table.add_column(title, justify='right', no_wrap=True)
    for pair in one.differing[:MOST_FIELDS]:
        table.add_row(_name(pair), *_cells(pair))
    return table


def _name(pair: Pair) -> str:
    group, _, name = pair.field.partition('.')
    unit = COMMAND_UNITS.get(name) if group == 'command' else None
    return f'{pair.field} [dim]{unit}[/]' if unit else pair.field


def _cells(pair: Pair):
    for value in (pair.recorded, pair.replayed):
        yield value if isinstance(value, str) else f'{value:.9g}'
    yield '' if pair.difference == float('inf') else f'{pair.difference:.1e}'
    yield f'{pair.allowed:.1e}' if pair.allowed else ''
