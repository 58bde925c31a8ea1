"""The closed loop in process against the node graph over Fast DDS."""

import numpy as np
import pytest
from recorded_runs import load_runs, run_experiment

from bags.run import load
from bags.storage import read

SCENARIO = 'double_lane_change'
# friction patches reach the plant by another path than everything else
SCENARIOS = (SCENARIO, 'split_mu')
# recorded with a new stamp at each repetition, sent once in process
REPEATED = ('/scenario/reference', '/scenario/road_edges')


@pytest.fixture(scope='module')
def bags(recorded_runs, tmp_path_factory):
    """Return the bags of the scenarios, driven through the nodes by the MPCC."""
    folder = tmp_path_factory.mktemp('split_mu')
    run_experiment(folder, 'split_mu', 'mpcc')
    return {
        SCENARIO: read.load(recorded_runs.bag('mpcc')),
        'split_mu': read.load(load_runs(folder, 'split_mu').bag('mpcc')),
    }


@pytest.mark.parametrize('name', SCENARIOS)
def test_over_ros_and_in_process_the_bits_are_the_same(simulated, bags, name):
    computed, _ = simulated.drive(name, 'mpcc')
    recorded_ = read.columns(bags[name])
    for topic in computed.keys() - set(REPEATED):
        for column, one in vars(computed[topic]).items():
            if column != 'values':
                other = getattr(recorded_[topic], column)
                assert np.array_equal(one, other), f'{topic}: {column}'
    assert computed['/scenario/obstacles'].values == recorded_['/scenario/obstacles'].values


def test_over_ros_and_in_process_the_facts_of_the_drive_are_the_same(simulated, bags):
    _, driven = simulated.drive(SCENARIO, 'mpcc')
    assert load(bags[SCENARIO].path).drive.facts == driven.facts


def test_a_slippery_patch_acts_on_the_wheels_on_it(simulated):
    computed, _ = simulated.drive('split_mu', 'mpcc')
    left, right = 0, 1
    kappa = computed['/vehicle/wheels'].slip[:, 2:]
    force = computed['/vehicle/wheels'].force_x_n[:, 2:]
    odometry = computed['/vehicle/odometry']
    x = np.interp(computed['/vehicle/wheels'].t_s, odometry.t_s, odometry.x_m)
    slope = np.mean(force[(x > 50) & (x < 80)], axis=0) / np.mean(
        kappa[(x > 50) & (x < 80)], axis=0
    )
    before = np.mean(force[x < 35], axis=0) / np.mean(kappa[x < 35], axis=0)
    assert abs(before[left] / before[right] - 1) < 0.05
    assert slope[left] < slope[right]
