"""How fast a recording is shown: rate, pause and seek."""

import pytest

from bags.viewers import playback_server

S = 1_000_000_000


def test_the_pace_follows_rate_pause_and_seek():
    pace = playback_server.Pace(10 * S, 20 * S, 2.0)
    assert pace.now(100.0) == 10 * S
    assert pace.now(101.0) == 12 * S
    pace.change(101.0, playing=False)
    assert pace.now(150.0) == 12 * S
    pace.change(150.0, playing=True, rate=0.5)
    assert pace.now(152.0) == 13 * S
    pace.change(152.0, seek_ns=19 * S)
    assert pace.now(153.0) == pytest.approx(19.5 * S)
    assert pace.now(999.0) == 20 * S
    pace.change(999.0, seek_ns=0)
    assert pace.now(999.0) == 10 * S
