"""Every controller at the operating point comes to the numbers that are tracked in paper/."""

from pathlib import Path

import pytest

from bags.errors import BagError
from experiments.paper import operating_point

PAPER = Path(__file__).parents[2] / 'paper'


@pytest.mark.parametrize('controller', operating_point.CONTROLLERS)
def test_a_controller_reproduces_its_tracked_numbers(controller):
    known = operating_point.read(PAPER)[controller]
    assert set(known) == set(operating_point.TOLERANCES)
    found = operating_point.simulate(controller)
    assert not operating_point.find_deviations(controller, known, found)


def test_a_number_beyond_its_tolerance_is_named():
    known = operating_point.read(PAPER)['mpcc']
    tolerance = operating_point.TOLERANCES['peak_sideslip_deg']
    far = known | {'peak_sideslip_deg': known['peak_sideslip_deg'] + 1.1 * tolerance}
    near = known | {'peak_sideslip_deg': known['peak_sideslip_deg'] + 0.9 * tolerance}
    assert [one.name for one in operating_point.find_deviations('mpcc', known, far)] == [
        'peak_sideslip_deg'
    ]
    assert operating_point.find_deviations('mpcc', known, near) == []


def test_a_folder_without_numbers_is_refused(tmp_path):
    with pytest.raises(BagError, match=operating_point.FILE):
        operating_point.read(tmp_path)
