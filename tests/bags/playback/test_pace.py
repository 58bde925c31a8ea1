"""The moment of the bag follows the wall clock, and stands still when told to."""

from bags.playback import PlaybackClock

S = 1_000_000_000
BEGIN_NS = 77 * S


def test_rate_scales_time():
    pace = PlaybackClock(2.0, BEGIN_NS)
    assert pace.position_ns(BEGIN_NS + 3 * S) == 6 * S
    assert pace.wait_s(10 * S, BEGIN_NS + 3 * S) == 2.0
    assert pace.wait_s(4 * S, BEGIN_NS + 3 * S) == -1.0


def test_pause_costs_no_moment_of_the_bag():
    pace = PlaybackClock(1.0, BEGIN_NS)
    pace.toggle(BEGIN_NS + 2 * S)
    assert pace.position_ns(BEGIN_NS + 50 * S) == 2 * S
    assert pace.wait_s(3 * S, BEGIN_NS + 50 * S) is None
    pace.toggle(BEGIN_NS + 100 * S)
    assert pace.wait_s(3 * S, BEGIN_NS + 100 * S) == 1.0


def test_what_was_due_before_the_pause_is_still_due():
    pace = PlaybackClock(1.0, BEGIN_NS)
    pace.toggle(BEGIN_NS + 2 * S)
    assert pace.wait_s(2 * S, BEGIN_NS + 9 * S) == 0.0


def test_step_brings_a_stretch_and_at_least_the_next_message():
    pace = PlaybackClock(1.0, BEGIN_NS, paused=True)
    pace.step(S, S // 2, BEGIN_NS)
    assert pace.wait_s(S, BEGIN_NS) == 0.0
    assert pace.wait_s(S + 1, BEGIN_NS) is None
    pace.step(S, 9 * S, BEGIN_NS)
    assert pace.wait_s(9 * S, BEGIN_NS) == 0.0
    assert pace.wait_s(9 * S + 1, BEGIN_NS) is None


def test_step_while_playing_pauses():
    pace = PlaybackClock(1.0, BEGIN_NS)
    pace.step(0, 3 * S, BEGIN_NS + 2 * S)
    assert pace.paused
    assert pace.position_ns(BEGIN_NS + 20 * S) == 3 * S


def test_playing_goes_on_from_the_last_step():
    pace = PlaybackClock(1.0, BEGIN_NS, paused=True)
    pace.step(4 * S, 0, BEGIN_NS)
    pace.toggle(BEGIN_NS + 9 * S)
    assert not pace.paused
    assert pace.wait_s(5 * S, BEGIN_NS + 9 * S) == 1.0
