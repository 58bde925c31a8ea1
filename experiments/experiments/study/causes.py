"""Which single switch makes a claim hold, or undoes it, in which of the paired runs."""

from collections.abc import Mapping, Sequence
from typing import Any

from experiments.study import statistics
from experiments.study.claim_rules import NOT, Claim, Runs
from experiments.study.drives import Record
from experiments.study.variants import BASE, BASELINE, SWITCHES, Switch

WOULD = 'would bring it about'
Rows = Mapping[str, Sequence[Record]]  # of the ablation at the operating point, one per draw


def of(
    claim: Claim, cast: Sequence[Runs], rows: Rows, verdict: str
) -> tuple[str, list[dict[str, Any]]]:
    """Return the cause as a sentence, and the counts behind it.

    The role that the claim switches is played by the row before and by the row after each switch;
    the other roles by those who play them. The loose rule decides. A switch is a cause when it
    turns the rule in most of the runs, for certain: the Wilson interval of the share lies above
    one half.

    What does not hold has no cause. Of such a claim is told which switches would bring about its
    direction, in the cars that they make; those do not say why it is absent.
    """
    if claim.switched is None:
        return claim.reason, []
    data = [_turned(claim, cast, rows, switch) for switch in SWITCHES]
    # the baseline's switches say nothing about the other roles
    data = [one for one in data if one['before'] == BASE or claim.switched == 'frenet']
    forth = [one for one in data if one['before'] == BASE]
    back = [one for one in data if one['before'] == BASELINE]
    if verdict == NOT:
        return f'direction only ({claim.loose_says}): {_said(WOULD, forth, "gained")}', data
    key = 'lost' if claim.switched == 'mpcc' else 'gained'
    said = [_said('makes it fail' if key == 'lost' else 'brings it about', forth, key)]
    if any(one['held_before'] for one in back):
        said.append(_said('undoes it', back, 'lost'))
    return '; '.join(said), data


def _turned(claim: Claim, cast: Sequence[Runs], rows: Rows, switch: Switch) -> dict[str, Any]:
    held = {
        name: [
            claim.loose({**runs, claim.switched: record}) for runs, record in zip(cast, rows[name])
        ]
        for name in (switch.before, switch.after)
    }
    pairs = list(zip(held[switch.before], held[switch.after]))
    gained = [k for k, (before, after) in enumerate(pairs, start=1) if after and not before]
    lost = [k for k, (before, after) in enumerate(pairs, start=1) if before and not after]
    return {
        'factor': switch.factor,
        'before': switch.before,
        'after': switch.after,
        'pairs': len(pairs),
        'held_before': sum(held[switch.before]),
        'gained': gained,
        'lost': lost,
    }


def _said(what, data, key):
    """Name the switches that do it in most runs, then in some."""
    most, some = [], []
    for one in data:
        count, of = len(one[key]), one['pairs'] if key == 'gained' else one['held_before']
        if not count:
            continue
        told = f'{one["factor"]} ({count}/{of})'
        (most if statistics.share_of(count, of).low > 0.5 else some).append(told)
    if not most and not some:
        return f'no switch alone {what}'
    parts = [f'alone {what} in most runs: {", ".join(most) or "none"}']
    if some:
        parts.append(f'in some: {", ".join(some)}')
    return ', '.join(parts)
