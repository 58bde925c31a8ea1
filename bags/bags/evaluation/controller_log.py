"""What the controller published about its ticks: numbers of /controller/why, plans, answers."""

import math
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from msgs_yaml.types import Why

PREDICTION, WHY = '/controller/prediction', '/controller/why'
CHOSEN = 'candidates.chosen'
STATE_STALE = 'state_stale'  # the reason of a command that answers no state


class CandidateLine(NamedTuple):
    """One plan that was compared."""

    number: int  # 0 is the plan followed before
    name: str  # the initial guess: `left of 1`, `brake`
    points: np.ndarray  # (n, 2) m, map
    is_chosen: bool
    is_clean: bool  # touches nothing and stays on the road


def candidate_lines(why: Mapping[str, float | str]) -> list[CandidateLine]:
    """Return the plans of one tick that have a line; none where a tick compared nothing."""
    lines = []
    for number in range(int(why.get('candidates.count', 0))):
        key = f'candidates.{number}'
        text = why.get(f'{key}.line')
        if isinstance(text, str):
            points = np.array([pair.split(',') for pair in text.split()], float)
            chosen, clean = why.get(CHOSEN) == number, why.get(f'{key}.clean') == 1
            lines.append(CandidateLine(number, str(why[f'{key}.name']), points, chosen, clean))
    return lines


def report_number(report: Mapping[str, float | str], key: str) -> float:
    """Return a number of one report; not-a-number where the key has none."""
    value = report.get(key)
    return float(value) if isinstance(value, (int, float)) else math.nan


def report_numbers(reports: Iterable[Why], key: str) -> np.ndarray:
    """Return the number (n,) of each report; not-a-number where one has none."""
    return np.array([report_number(why.values, key) for why in reports], dtype=float)


def is_answer(command_ns: np.ndarray, reports: Iterable[Why]) -> np.ndarray:
    """Return for each command stamp (n,) [ns] whether it answers a state.

    Without `reports`, those of the controller, every command counts as an answer.
    """
    stale = [why.stamp_ns for why in reports if why.values.get('reason') == STATE_STALE]
    return ~np.isin(command_ns, stale)
