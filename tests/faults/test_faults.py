"""A choice of the faults, another one for each commit; `make faults` tries all of them."""

import random

import catalogue
import commit_seed
import lanes
import pytest
import suite

pytestmark = pytest.mark.ros
NAME = 'FAULT_SEED'  # environment variable that repeats a choice
# how many of a mode: in two lanes all of them take about a minute
CHOICE = {'realtime': 6, 'lockstep': 6}


def choice(faults, seed):
    """Return some faults, the same ones for the same seed."""
    chosen = []
    for mode, count in CHOICE.items():
        fitting = [fault for fault in faults if fault.mode == mode]
        chosen += random.Random(seed).sample(fitting, count)
    return chosen


# one test: the faults run beside each other, and share what may be tried again
@pytest.mark.alone
@pytest.mark.timeout(900)
def test_faults_end_as_they_must(tmp_path):
    seed = commit_seed.seed(NAME)
    print(f'chosen with {NAME}={seed}')
    faults, failed = choice(catalogue.load(), seed), []
    for verdict in suite.outcomes(faults, tmp_path, suite.Retries(), lanes.default()):
        print(suite.row(verdict))
        if not verdict.passed:
            failed.append(suite.row(verdict))
    assert not failed, '\n'.join([f'{NAME}={seed}', *failed])


def test_every_fault_is_chosen_for_some_seed():
    faults = catalogue.load()
    seen = {fault.name for seed in range(300) for fault in choice(faults, seed)}
    assert seen == {fault.name for fault in faults}
