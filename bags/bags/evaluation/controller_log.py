"""What the controller published about its ticks: numbers of /controller/why, plans, answers."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from bags.storage.columns import Columns
from msgs_yaml.types import Prediction, Why

PREDICTION, WHY = '/controller/prediction', '/controller/why'
REPORTED = ('friction.front', 'friction.rear', 'time.solve_ms')
CHOSEN = 'candidates.chosen'
STATE_STALE = 'state_stale'  # the reason of a command that answers no state


class CandidateLine(NamedTuple):
    """One plan that was compared."""

    number: int  # 0 is the plan followed before
    name: str  # the initial guess: `left of 1`, `brake`
    points: np.ndarray  # (n, 2) m, map
    is_chosen: bool
    is_clean: bool  # touches nothing and stays on the road


class ControllerLog(NamedTuple):
    """The data of one run that the report shows beyond the drive."""

    run_info: Mapping[str, str]  # metadata record of the run
    predictions: Sequence[Prediction]  # one per tick
    report_ns: np.ndarray  # (n,) stamps of the controller's reports
    numbers: Mapping[str, np.ndarray]  # (n,) of REPORTED; not-a-number where one is missing
    candidates: Sequence[Sequence[CandidateLine]] = ()  # of each report

    def __repr__(self):
        return f'ControllerLog({len(self.report_ns)} reports, {len(self.predictions)} plans)'


EMPTY_LOG = ControllerLog({}, (), np.empty(0, dtype=np.int64), {})


def controller_log(tables: Mapping[str, Columns], run_info: Mapping[str, str]) -> ControllerLog:
    """Return the log in the tables of a run by topic; parts whose topic is missing are empty."""
    predictions = tables[PREDICTION].values if PREDICTION in tables else ()
    if WHY not in tables:
        return EMPTY_LOG._replace(run_info=run_info, predictions=predictions)
    reports = [why.values for why in tables[WHY].values]
    numbers = {name: report_numbers(reports, name) for name in REPORTED}
    compared = [candidate_lines(values) for values in reports]
    return ControllerLog(run_info, predictions, tables[WHY].stamp_ns, numbers, compared)


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


def report_number(report: Mapping[str, float | str], key: str) -> float:
    """Return a number of one report; not-a-number where the key has none."""
    value = report.get(key)
    return float(value) if isinstance(value, (int, float)) else math.nan


def report_numbers(reports: Iterable[Mapping[str, float | str]], key: str) -> np.ndarray:
    """Return the number (n,) of each report."""
    return np.array([report_number(report, key) for report in reports], dtype=float)


def is_answer(command_ns: np.ndarray, reports: Iterable[Why]) -> np.ndarray:
    """Return for each command stamp (n,) [ns] whether it answers a state.

    Without `reports`, those of the controller, every command counts as an answer.
    """
    stale = [why.stamp_ns for why in reports if why.values.get('reason') == STATE_STALE]
    return ~np.isin(command_ns, stale)
