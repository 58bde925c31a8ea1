"""A seeded choice of the faults; `make faults` tries all of them."""

import random

import catalogue
import pytest
import suite

pytestmark = pytest.mark.ros
SEED = 7
DOMAIN = 73
# (mode, how many): a run takes about ten seconds
CHOICE = (('realtime', 6), ('lockstep', 6))


def few():
    """Return the same faults each time."""
    faults = catalogue.load()
    chosen = []
    for mode, count in CHOICE:
        fitting = [fault for fault in faults if fault.mode == mode]
        chosen += random.Random(SEED).sample(fitting, count)
    return chosen


@pytest.mark.parametrize('fault', few(), ids=lambda fault: fault.name)
def test_fault_ends_as_it_must(fault, tmp_path):
    verdict = suite.attempt(fault, tmp_path, DOMAIN)
    assert verdict.passed, suite.row(verdict)
