"""The plans that a controller compared in a tick, as lines: from the values of /controller/why."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

CHOSEN = 'candidates.chosen'


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
            clean = why.get(f'{key}.clean') == 1
            lines.append(
                CandidateLine(
                    number, str(why[f'{key}.name']), points, why.get(CHOSEN) == number, clean
                )
            )
    return lines
