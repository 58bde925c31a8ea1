"""A selection of the faults, another one for each commit; `make faults` runs all of them."""

import random

import catalogue
import commit_seed
import lanes
import pytest
import suite
import wall_clock

pytestmark = pytest.mark.ros
NAME = 'FAULT_SEED'  # environment variable that repeats a selection
# number by mode: those on the wall clock take about a minute
SAMPLE = {'realtime': 6, 'lockstep': 6}


def sample_faults(faults, seed):
    """Return some faults by mode, the same ones for the same seed."""
    selected = {}
    for mode, count in SAMPLE.items():
        fitting = [fault for fault in faults if fault.mode == mode]
        selected[mode] = random.Random(seed).sample(fitting, count)
    return selected


# a single test of a mode, because the faults run in parallel and share the retries; in lockstep the
# nodes wait for each other: other tests may take their time. So they may on the wall clock where
# the nodes have priority over them, and stalls of the machine are told from late nodes
ALONE = () if wall_clock.may_set_priority() else pytest.mark.alone


@pytest.mark.timeout(900)
@pytest.mark.parametrize('mode', [pytest.param('realtime', marks=ALONE), 'lockstep'])
def test_faults_end_in_the_expected_state(tmp_path, mode):
    seed = commit_seed.seed(NAME)
    print(f'selected with {NAME}={seed}')
    faults, failed = sample_faults(catalogue.load(), seed)[mode], []
    count = lanes.default() if mode == 'realtime' else 1
    for result in suite.run_faults(faults, tmp_path, suite.Retries(), count):
        print(suite.row(result))
        if not result.passed:
            failed.append(suite.row(result))
    assert not failed, '\n'.join([f'{NAME}={seed}', *failed])


def test_every_fault_is_selected_for_some_seed():
    faults = catalogue.load()
    samples = [sample_faults(faults, seed).values() for seed in range(300)]
    selected = {fault.name for sample in samples for few in sample for fault in few}
    assert selected == {fault.name for fault in faults}
