"""Every controller at the operating point comes to the numbers that are tracked in paper/."""

from pathlib import Path

import pytest

from bags.errors import BagError
from experiments.paper import point

PAPER = Path(__file__).parents[2] / 'paper'


@pytest.mark.parametrize('controller', point.CONTROLLERS)
def test_a_controller_comes_to_its_tracked_numbers(controller):
    known = point.tracked(PAPER)[controller]
    assert set(known) == set(point.TOLERANCES)
    found = point.drive(controller)
    assert not point.deviations(controller, known, found)


def test_a_number_beyond_its_tolerance_is_named():
    known = point.tracked(PAPER)['mpcc']
    tolerance = point.TOLERANCES['peak_sideslip_deg']
    far = known | {'peak_sideslip_deg': known['peak_sideslip_deg'] + 1.1 * tolerance}
    near = known | {'peak_sideslip_deg': known['peak_sideslip_deg'] + 0.9 * tolerance}
    assert [one.name for one in point.deviations('mpcc', known, far)] == ['peak_sideslip_deg']
    assert point.deviations('mpcc', known, near) == []


def test_a_folder_without_numbers_is_refused(tmp_path):
    with pytest.raises(BagError, match=point.FILE):
        point.tracked(tmp_path)
