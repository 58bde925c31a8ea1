"""A second run of the node graph over Fast DDS; the first is the fixture `recorded_runs`."""

import pytest
from recorded_runs import load_runs, run_experiment


@pytest.fixture(scope='module')
def again(dds, tmp_path_factory):
    """Drive the double lane change with the MPCC once more."""
    out = tmp_path_factory.mktemp('again')
    run_experiment(out, 'double_lane_change', 'mpcc')
    return load_runs(out, 'double_lane_change')
