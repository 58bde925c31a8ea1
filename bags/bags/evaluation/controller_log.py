"""Numbers out of the reports of the controller, whatever stands there.

Which commands answer a state: the controller also sends some without one, and says so.

What a bag says of a run beyond the drive: where it came from, what was planned, what it cost."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from bags.storage import read
from msgs_yaml.types import Prediction, Why


def report_number(report: Mapping[str, float | str], key: str) -> float:
    """Return a number of one report; not-a-number where there is none under that key."""
    found = report.get(key)
    return float(found) if isinstance(found, (int, float)) else math.nan


def report_numbers(reports: Iterable[Mapping[str, float | str]], key: str) -> np.ndarray:
    """Return the number (n,) of each report."""
    return np.array([report_number(report, key) for report in reports], dtype=float)


STATE_STALE = 'state_stale'  # the reason of a command that answers no state


def is_answer(command_ns: np.ndarray, whys: Iterable[Why]) -> np.ndarray:
    """Return, command by command (n,), whether it answers a state; by stamp [ns].

    `whys` are what the controller said; without any, every command counts as an answer.
    """
    blind = [why.stamp_ns for why in whys if why.values.get('reason') == STATE_STALE]
    return ~np.isin(command_ns, blind)


PREDICTION, WHY = '/controller/prediction', '/controller/why'
REPORTED = ('friction.front', 'friction.rear', 'time.solve_ms', 'split.front')


class ControllerLog(NamedTuple):
    """Everything the report shows of one run that the judge does not need."""

    info: Mapping[str, str]  # the notes of the run
    predictions: Sequence[Prediction]  # one per tick
    answered_ns: np.ndarray  # (n,) stamps of the controller's reports
    said: Mapping[str, np.ndarray]  # (n,) what they say under SAID, not-a-number where nothing


EMPTY_LOG = ControllerLog({}, (), np.empty(0, dtype=np.int64), {})


def read_controller_log(bag: read.Bag) -> ControllerLog:
    """Return the account of a bag; a controller that said nothing leaves its part empty."""
    said = [topic for topic in (PREDICTION, WHY) if topic in bag.recordings]
    said = [topic for topic in said if bag.recordings[topic].payloads]
    tables = read.columns(bag, said)
    predictions = tables[PREDICTION].values if PREDICTION in tables else ()
    if WHY not in tables:
        return EMPTY_LOG._replace(info=bag.run_info, predictions=predictions)
    reports = [why.values for why in tables[WHY].values]
    said = {name: report_numbers(reports, name) for name in REPORTED}
    return ControllerLog(bag.run_info, predictions, tables[WHY].stamp_ns, said)
