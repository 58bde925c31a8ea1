"""A selection of the faults, another one for each commit; `make faults` runs all of them."""

import random

import catalogue
import commit_seed
import lanes
import pytest
import suite

pytestmark = pytest.mark.ros
NAME = 'FAULT_SEED'  # environment variable that repeats a selection
# number by mode: in two lanes all of them take about a minute
SAMPLE = {'realtime': 6, 'lockstep': 6}


def sample_faults(faults, seed):
    """Return some faults, the same ones for the same seed."""
    selected = []
    for mode, count in SAMPLE.items():
        fitting = [fault for fault in faults if fault.mode == mode]
        selected += random.Random(seed).sample(fitting, count)
    return selected


# a single test, because the faults run in parallel and share the retries
@pytest.mark.alone
@pytest.mark.timeout(900)
def test_faults_end_in_the_expected_state(tmp_path):
    seed = commit_seed.seed(NAME)
    print(f'selected with {NAME}={seed}')
    faults, failed = sample_faults(catalogue.load(), seed), []
    for result in suite.run_faults(faults, tmp_path, suite.Retries(), lanes.default()):
        print(suite.row(result))
        if not result.passed:
            failed.append(suite.row(result))
    assert not failed, '\n'.join([f'{NAME}={seed}', *failed])


def test_every_fault_is_selected_for_some_seed():
    faults = catalogue.load()
    selected = {fault.name for seed in range(300) for fault in sample_faults(faults, seed)}
    assert selected == {fault.name for fault in faults}
