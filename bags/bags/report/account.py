"""What a bag says of a run beyond the drive: where it came from, what was planned, what it cost."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from bags.storage import read
from bags.verdict import reported
from msgs_yaml.types import Prediction

PREDICTION, WHY = '/controller/prediction', '/controller/why'
SAID = ('friction.front', 'friction.rear', 'time.solve_ms', 'split.front')


class Account(NamedTuple):
    """Everything the report shows of one run that the judge does not need."""

    info: Mapping[str, str]  # the notes of the run
    predictions: Sequence[Prediction]  # one per tick
    answered_ns: np.ndarray  # (n,) stamps of the controller's reports
    said: Mapping[str, np.ndarray]  # (n,) what they say under SAID, not-a-number where nothing


NOTHING = Account({}, (), np.empty(0, dtype=np.int64), {})


def of_bag(bag: read.Bag) -> Account:
    """Return the account of a bag; a controller that said nothing leaves its part empty."""
    said = [topic for topic in (PREDICTION, WHY) if topic in bag.recordings]
    said = [topic for topic in said if bag.recordings[topic].payloads]
    tables = read.columns(bag, said)
    predictions = tables[PREDICTION].values if PREDICTION in tables else ()
    if WHY not in tables:
        return NOTHING._replace(info=bag.run_info, predictions=predictions)
    reports = [why.values for why in tables[WHY].values]
    said = {name: reported.numbers(reports, name) for name in SAID}
    return Account(bag.run_info, predictions, tables[WHY].stamp_ns, said)
