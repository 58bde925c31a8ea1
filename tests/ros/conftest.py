"""A second run of the ring over real Fast DDS; the first one is the fixture `rings`."""

import pytest
from driven import drive, load


@pytest.fixture(scope='module')
def again(dds, tmp_path_factory):
    """Drive the double lane change with the MPCC once more."""
    out = tmp_path_factory.mktemp('again')
    drive(out, 'double_lane_change', 'mpcc')
    return load(out, 'double_lane_change')
