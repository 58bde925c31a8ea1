"""`bags info`: what a bag holds and how the run behind it went in time."""

from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from bags.storage.invalid_messages import describe_invalid

MB = 1e6
NOT_KNOWN = '-'


def table(topics: dict[str, dict[str, Any]]) -> Table:
    """One row per topic; what is lost or missing is red."""
    made = Table(box=None, header_style='bold', pad_edge=False)
    made.add_column('topic')
    for title in ('messages', 'rate in Hz', 'longest gap in s', 'lost'):
        made.add_column(title, justify='right')
    for name, found in topics.items():
        lost = _number(found['lost'], 'd')
        if found['lost']:
            lost += f' in {found["lost_places"]} places'
        made.add_row(
            name,
            Text(str(found['messages']), style='' if found['messages'] else 'red'),
            _number(found['rate_hz'], '.2f'),
            _number(found['longest_gap_s'], '.3f'),
            Text(lost, style='red' if found['lost'] else ''),
        )
    return made


def show(found: dict[str, Any], console: Console) -> None:
    """Print a summary for a person."""
    size = f'{found["bytes"] / MB:.2f} MB'
    if len(found['files']) > 1:
        size += f' in {len(found["files"])} files'
    console.print(Text(found['path'], style='bold'), f'{size},', found['mode'])
    console.print(f'{found["messages"]} messages in {found["duration_s"]:.3f} s')
    if found['damage']:
        console.print(Text(found['damage'], style='red'))
    console.print(table(found['topics']))
    for line in describe_invalid(found):
        console.print(line, style='red', markup=False, highlight=False, soft_wrap=True)
    for line in _loop(found):
        console.print(line, markup=False, highlight=False)
    for name, value in found['run'].items():
        # a hash that is copied is one word
        console.print(f'{name}: {_short(value)}', markup=False, highlight=False, soft_wrap=True)


def _loop(found):
    if found['latency_ms'] is not None:
        named = ', '.join(f'{name} {value:.2f}' for name, value in found['latency_ms'].items())
        yield f'state to command in ms: {named}'
    if found['ticks'] is not None:
        yield told(found['ticks'])
    if found['rungs'] is not None:
        rungs = ', '.join(f'{name} {n}' for name, n in found['rungs'].items())
        count, last = found['reports'].values()
        ended = f', {last} of them on the last state, which is no tick' if last else ''
        yield f'{count} reports of the controller{ended}'
        yield f'rungs: {rungs}'
        for reason, n in found['fallbacks'].items():
            yield f'  fell back {n} times: {reason}'


def told(ticks: Mapping[str, int]) -> str:
    """Return counted ticks as a line for a person."""
    return (
        f'{ticks["count"]} ticks, {ticks["missed"]} missed: {ticks["unanswered"]} unanswered, '
        f'{ticks["late"]} late; {ticks["blind"]} commands without a state'
    )


def _number(value, form):
    return NOT_KNOWN if value is None else f'{value:{form}}'


def _short(text, longest=100):
    line = ' '.join(text.split())
    return line if len(line) <= longest else f'{line[:longest]} ...'
