"""What can be said of a single drive by yes or no, and in which drives one switch turns it."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from experiments.study.claim_rules import STABLE_DEG
from experiments.study.drives import Record
from experiments.study.variants import Switch


def cleared(run: Record) -> bool:
    """Tell whether the drive was completed without touching an obstacle or leaving the road."""
    return run.value('completed') and not run.value('collided') and run.value('min_v2e_m') > 0.0


VERDICTS: dict[str, Callable[[Record], bool]] = {
    'cleared': cleared,
    'entered unsafe area': lambda run: run.value('entered_unsafe_area'),
    f'sideslip > {STABLE_DEG:g} deg': lambda run: run.value('peak_sideslip_deg') > STABLE_DEG,
    'brakes, -500 N': lambda run: run.value('brake_onset_at_m') is not None,
    'brakes, -1500 N': lambda run: run.value('brake_onset_hard_at_m') is not None,
}


def flips(
    switch: Switch, cells: Mapping[str, Mapping[str, Sequence[Record]]]
) -> list[dict[str, Any]]:
    """Return, verdict by verdict, the paired drives in which the switch alone turns it.

    `cells` holds the records by the name of the cell and of the row, one per draw. A drive is
    called by its cell and the number of its draw.
    """
    rows = []
    for verdict, holds in VERDICTS.items():
        turned_on, turned_off, pairs = [], [], 0
        for cell, records in cells.items():
            for number, (before, after) in enumerate(
                zip(records[switch.before], records[switch.after]), start=1
            ):
                pairs += 1
                if holds(before) != holds(after):
                    chosen = turned_on if holds(after) else turned_off
                    chosen.append(f'{cell} #{number}')
        rows.append(
            {
                'factor': switch.factor,
                'before': switch.before,
                'after': switch.after,
                'verdict': verdict,
                'pairs': pairs,
                'turned_on': turned_on,
                'turned_off': turned_off,
            }
        )
    return rows
