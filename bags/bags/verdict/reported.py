"""Numbers out of the reports of the controller, whatever stands there."""

import math
from collections.abc import Iterable, Mapping

import numpy as np


def number(report: Mapping[str, float | str], key: str) -> float:
    """Return a number of one report; not-a-number where there is none under that key."""
    found = report.get(key)
    return float(found) if isinstance(found, (int, float)) else math.nan


def numbers(reports: Iterable[Mapping[str, float | str]], key: str) -> np.ndarray:
    """Return the number (n,) of each report."""
    return np.array([number(report, key) for report in reports], dtype=float)
