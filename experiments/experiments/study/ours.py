"""What came out here for a claim, as text: the numbers of every role, quantity by quantity."""

from collections.abc import Mapping, Sequence
from itertools import groupby

from experiments.study import statistics
from experiments.study.claim_rules import Runs, Shown
from experiments.study.drives import Record
from experiments.study.quantities import BY_NAME, Quantity

OVERSHOOTS = 'overshoots'  # a list rather than a number
AFTER_M = 115.0  # in the second change back, 10 m before the paper's first overshoot


def told(shown: Sequence[Shown], cast: Sequence[Runs], names: Mapping[str, str]) -> str:
    """Return median and range of what is shown over the runs; `names` are printed for the roles.

    "quantity [unit]: role median [least, most], role ..."; quantities are separated by semicolons.
    """
    parts = []
    for quantity, group in groupby(shown, key=lambda one: one.quantity):
        found = {names[role]: [runs[role] for runs in cast] for role, _ in group}
        parts.append(_overshoots(found) if quantity == OVERSHOOTS else _numbers(quantity, found))
    return '; '.join(parts)


def _numbers(name, found: Mapping[str, Sequence[Record]]):
    quantity = BY_NAME[name]
    unit = '' if quantity.unit == '-' else f' [{quantity.unit}]'
    values = (
        f'{role} {_number(quantity, [run.value(name) for run in runs])}'
        for role, runs in found.items()
    )
    return f'{quantity.title}{unit}: {", ".join(values)}'


def _number(quantity: Quantity, values):
    over = statistics.summary(values)
    if not over.runs:
        return 'none'
    median, least, most = map(quantity.told, (over.median, over.least, over.most))
    if over.median is None:  # in fewer than half of the runs
        return f'{least} to {most} in {over.runs} of {len(values)} runs'
    some = f' in {over.runs} of {len(values)} runs' if over.runs < len(values) else ''
    return f'{median} [{least}, {most}]{some}'


def _overshoots(found: Mapping[str, Sequence[Record]]):
    """Tell where and how wide the cars were beyond the path after the second change."""
    parts = (f'{role} {_widest(runs)}' for role, runs in found.items())
    return f'widest beyond {AFTER_M:g} m [m]: {", ".join(parts)}'


def _widest(runs):
    widest = [
        max(
            (one for one in run.value(OVERSHOOTS) if one['x_m'] >= AFTER_M),
            key=lambda one: one['amount_m'],
            default=None,
        )
        for run in runs
    ]
    known = [one for one in widest if one is not None]
    if not known:
        return 'none'
    amount, x = (statistics.summary([one[key] for one in known]) for key in ('amount_m', 'x_m'))
    return (
        f'{amount.median:.2f} [{amount.least:.2f}, {amount.most:.2f}] at {x.median:.0f} m in '
        f'{len(known)} of {len(runs)} runs'
    )
