"""What the actuators have been told, over time."""

import pytest

from mpcc_controller.driving import commanded
from mpcc_controller.driving.commanded import Ramp
from mpcc_controller.driving.target import SetPoints

HERE, THERE = SetPoints(0.0, 0.0), SetPoints(0.1, -1000.0)
MS = 1_000_000


def test_pieces_meet_where_the_ramp_begins_and_ends():
    ramp = Ramp(10 * MS, HERE, 30 * MS, THERE, 0.6)
    found = commanded.pieces(ramp, 0, 50 * MS)
    assert [one.seconds for one in found] == pytest.approx([0.01, 0.02, 0.02])
    assert [one.begin for one in found] == [HERE, HERE, THERE]
    assert [one.end for one in found] == [HERE, THERE, THERE]


def test_a_command_that_was_due_at_once_has_no_piece_without_length():
    step = Ramp(20 * MS, HERE, 20 * MS, THERE, 0.6)
    found = commanded.pieces(step, 0, 50 * MS)
    assert [one.seconds for one in found] == pytest.approx([0.02, 0.03])
    assert found[-1].end == THERE
