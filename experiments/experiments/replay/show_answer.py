"""One tick for a person: commands, cost, distances, limits and sensitivities as tables."""

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from experiments.replay.fields import COMMAND_UNITS
from experiments.replay.resolve import Answer

MM = 1e3
PERCENT = 0.01
INSIDE = 'at a stage; inside: the stages nearer than the safety distance'
UNITS = {
    'delta': 'rad', 'Fx': 'N', 'd_delta': 'rad/s', 'd_Fx': 'N/s', 'lambda_b': '-', 'slack': 'm',
    'front': 'of mu Fz', 'rear': 'of mu Fz', 'total': 'of mu Fz', 'track': 'm', 'speed': 'm/s',
}  # fmt: skip


def show(answer: Answer, console: Console) -> None:
    """Print everything that was asked for."""
    tick, solved = answer.tick, answer.solved
    console.print(
        f'{answer.name}, tick {tick.number} at {tick.t_s:.2f} s: recorded {tick.why.message}',
        markup=False,
        highlight=False,
    )
    console.print(f'solved again: {_ended(solved)}', highlight=False)
    if answer.changed:
        console.print(f'changed: {_ended(answer.changed)}', highlight=False)
    console.print(_verdict(answer), highlight=False)
    for table in (_commands, _terms, _distances, _active, _sensitivities):
        made = table(answer)
        if made is not None:
            console.print()
            console.print(made)


def _ended(solved):
    return f'{solved.told} after {solved.iterations} iterations'


def _verdict(answer):
    if not answer.command:
        return '[yellow]its command was not recorded[/]'
    if answer.is_same:
        return '[green]the command is the recorded one[/]'
    why = [*answer.tick.gaps]
    if answer.tick.why.values.get('gate', 'passed') != 'passed':
        why.append('the gate turned it back')
    if answer.tick.why.values.get('rung') in ('shifted', 'braking'):
        why.append('the plan of this tick was not followed')
    if answer.chain:
        why.append(f'{answer.chain} ticks before it are answered differently')
    because = f': {"; ".join(why)}' if why else ''
    return f'[red]the command is not the recorded one[/]{because}'


def _table(title, answer, *columns):
    """A table with a column for what was solved, and one for what was changed."""
    made = Table(
        title=title, title_justify='left', box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False
    )
    for i, name in enumerate(columns):
        made.add_column(name, justify='right' if i else 'left', no_wrap=True)
    return made


def _both(answer):
    return (answer.solved, answer.changed) if answer.changed else (answer.solved,)


def _heads(answer, unit=''):
    return [f'{head}{unit}' for head in ('again', 'changed')[: len(_both(answer))]]


def _commands(answer):
    made = _table('command', answer, '', 'unit', 'recorded', *_heads(answer))
    for name, unit in COMMAND_UNITS.items():
        values = [answer.tick.command, *(one.command for one in _both(answer))]
        cells = (f'{getattr(value, name):.6g}' if value else '–' for value in values)
        made.add_row(name, unit, *cells)
    return made


def _terms(answer):
    made = _table('cost', answer, 'term', *_heads(answer), *_heads(answer, ': weight'))
    names = dict.fromkeys(name for one in _both(answer) for name in one.terms)
    for name in names:
        terms = (_number(one.terms.get(name), '.4f') for one in _both(answer))
        weights = (_number(one.weights.get(name), '.4g') for one in _both(answer))
        made.add_row(name, *terms, *weights)
    made.add_section()
    made.add_row('sum', *(f'{one.cost:.4f}' for one in _both(answer)))
    return made


def _number(value, form):
    return '–' if value is None else f'{value:{form}}'


def _distances(answer):
    made = _table('least distance of the plan', answer, 'to', *_heads(answer))
    names = dict.fromkeys(d.name for one in _both(answer) for d in one.distances)
    for name in names:
        found = ({d.name: d for d in one.distances}.get(name) for one in _both(answer))
        made.add_row(name, *('–' if one is None else _distance(one) for one in found))
    made.caption, made.caption_justify = INSIDE, 'left'
    return made


def _distance(one):
    (inside,) = np.nonzero(one.safe > one.D)
    stages = f', inside {inside[0]}–{inside[-1]}' if len(inside) else ''
    return f'{np.min(one.D):.3f} m at {int(np.argmin(one.D))}{stages}'


def _active(answer):
    made = _table('limits in force', answer, 'limit', 'value', 'unit', 'stages', 'multiplier')
    for label, one in zip(_heads(answer), _both(answer)):
        for limit in one.active:
            stages = f'{limit.first}–{limit.last}' if limit.last > limit.first else f'{limit.first}'
            made.add_row(
                f'{label}: {limit.side} limit of {limit.quantity}',
                f'{limit.limit:.4g}',
                UNITS.get(limit.quantity, ''),
                stages,
                f'{limit.multiplier:.3g} at {limit.at}',
            )
        if not one.active:
            made.add_row(f'{label}: none')
    return made


def _sensitivities(answer):
    if not answer.sensitivities:
        return None
    made = _table(
        'when a weight grows by one percent',
        answer,
        'weight', 'value', 'cost', 'by differences', 'least V2O, mm',
    )  # fmt: skip
    for one in answer.sensitivities:
        made.add_row(
            one.weight,
            f'{one.value:.4g}',
            f'{PERCENT * one.cost:+.6f}',
            f'{PERCENT * one.cost_difference:+.6f}',
            '–' if np.isnan(one.v2o) else f'{PERCENT * MM * one.v2o:+.4f}',
        )
    return made
