import re

import numpy as np
import pytest

from bags.errors import BagError
from experiments import cli
from experiments.replay import recorded_ticks, tick_choice
from experiments.replay.tick_choice import Moment

from .conftest import GOLDEN


@pytest.fixture(scope='module')
def choose(golden):
    return lambda name='mpcc', **named: tick_choice.choose(golden(name), Moment(**named))


def test_a_time_means_the_last_tick_until_then(choose):
    assert choose(time=2.25).number == 45
    assert choose(time=2.299).number == 45
    assert choose(time=0.0).number == 0
    assert choose(tick=45).t == pytest.approx(2.25)


def test_a_station_means_the_last_tick_until_there(choose):
    chosen = choose(station=70.0)
    assert chosen.station <= 70.0 < choose(tick=chosen.number + 1).station


@pytest.fixture(scope='module')
def states(golden):
    return [tick.inputs for tick in recorded_ticks.read_ticks(golden('mpcc'))]


def test_closest_is_where_a_circle_of_the_car_is_nearest_to_an_obstacle(choose, states):
    gaps = [
        min(np.hypot(o.X - s.state.X, o.Y - s.state.Y) - o.r_obs - 1.1 for o in s.obstacles.items)
        for s in states
    ]
    chosen = choose(event='closest')
    # the recording holds the states of the ticks alone
    assert chosen.number == int(np.argmin(gaps))
    assert chosen.because == f'least distance to obstacle 1, {min(gaps):.2f} m'


def test_sideslip_is_where_it_is_largest(choose, states):
    angles = [abs(np.arctan2(s.state.vy, s.state.vx)) for s in states]
    chosen = choose(event='sideslip')
    assert chosen.number == int(np.argmax(angles))
    assert f'{np.degrees(max(angles)):.1f} deg' in chosen.because


def test_the_nearest_edge_is_named(choose):
    assert choose(event='edge').because.startswith('least distance to the ')


def test_loss_is_a_second_before_the_car_was_lost_first(choose, golden):
    chosen = choose('mpcc_no_ca', event='loss')
    assert re.match(
        r'1\.0 s before station \d+ m, where it collided with obstacle 1', chosen.because
    )
    ticks = recorded_ticks.read_ticks(golden('mpcc_no_ca'))
    gaps = np.array(
        [
            min(np.hypot(o.X - s.X, o.Y - s.Y) - o.r_obs - 1.1 for o in obstacles.items)
            for s, obstacles in ((tick.inputs.state, tick.inputs.obstacles) for tick in ticks)
        ]
    )
    assert np.argmax(gaps < 0.0) - chosen.number in (20, 21)


@pytest.mark.parametrize(
    ('named', 'text'),
    [
        ({'event': 'loss'}, 'the car neither collided nor left the road nor slid'),
        ({'time': 99.0}, 'no tick at time 99 s; it has 0 to '),
        ({'station': -50.0}, 'no tick at station -50 m; it has '),
        ({'tick': 9999}, 'no tick 9999; it has 0 to '),
        ({'event': 'fallback'}, 'every tick followed a fresh plan'),
    ],
)
def test_what_the_recording_does_not_have_is_refused_with_what_it_has(choose, named, text):
    with pytest.raises(BagError, match=text):
        choose(**named)


def test_the_command_says_which_tick_it_took(tmp_path, capsys):
    command = ['resolve', str(GOLDEN / 'mpcc'), '--at', 'closest', '--out', str(tmp_path)]
    assert cli.main(command) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert 'least distance to obstacle ' in first
    assert first.startswith('tick ')
