"""Obstacles that vanish from the message for a moment: kept, moved on, forgotten in time."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.driving import obstacle_perception
from mpcc_controller.driving.obstacle_perception import Sightings
from mpcc_controller.driving.records import unknown_state
from mpcc_controller.problem.obstacle_motion import ExpectedObstacle, position
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import Obstacle, Obstacles

MS = 1_000_000
MEMORY_MS = 300
CAR = Obstacle(id=3, X=10.0, Y=-2.0, r_obs=1.05, vX=12.0, vY=-5.0)
CONE = Obstacle(id=4, X=30.0, Y=1.0, r_obs=0.3, vX=0.0, vY=0.0)


@pytest.fixture
def memory(params):
    return Seen(params, MEMORY_MS / 1000)


class Seen:
    """What is known of obstacles from message to message, in no path and on no road."""

    def __init__(self, params, memory_s):
        surroundings = replace(params.surroundings, memory_s=memory_s)
        self.params = replace(params, surroundings=surroundings)
        self.reset()

    def reset(self):
        self.sightings = Sightings(unknown_state(0))

    def known(self, seen):
        scene, now = Scene(None, None, seen), (seen.stamp_ns, self.params)
        state = self.sightings.true_state
        self.sightings = obstacle_perception.observe(self.sightings, scene, state, *now)
        return obstacle_perception.scene_known(self.sightings, scene, *now).obstacles


def message(at_ms, *items):
    return Obstacles(at_ms * MS, items)


def known(memory, seen):
    return memory.known(seen)


@settings(max_examples=30)
@given(
    missed_ms=st.integers(1, MEMORY_MS),
    braking=st.one_of(st.none(), st.floats(0.5, 10.0)),
)
def test_an_obstacle_that_vanishes_goes_on_as_it_was_expected_to(params, missed_ms, braking):
    """The reference is the motion over the horizon that was expected when it was seen last."""
    memory = Seen(params, MEMORY_MS / 1000)
    last = CAR if braking is None else ExpectedObstacle(*CAR, braking=braking)
    known(memory, message(0, last, CONE))
    seen, remembered = known(memory, message(missed_ms, CONE)).items
    assert seen == CONE
    expected = position(last, missed_ms / 1000)
    # a braking car counts as standing below 0.5 m/s, at most 0.25 m before it does
    np.testing.assert_allclose((remembered.X, remembered.Y), expected, atol=0.26 if braking else 0)
    assert (remembered.id, remembered.r_obs) == (CAR.id, CAR.r_obs)


def test_it_is_forgotten_when_the_memory_is_over(memory):
    known(memory, message(0, CAR))
    assert len(known(memory, message(MEMORY_MS, CONE)).items) == 2
    assert known(memory, message(MEMORY_MS + 50, CONE)) == message(MEMORY_MS + 50, CONE)
    # and the message that comes later with it counts as it is
    again = message(MEMORY_MS + 100, CAR._replace(X=17.0), CONE)
    assert known(memory, again) == again


def test_what_is_seen_counts_and_what_is_remembered_is_not_seen(memory):
    """Its age counts from when it was last in a message, not from when it was last remembered."""
    known(memory, message(0, CAR))
    for at_ms in range(50, MEMORY_MS + 1, 50):
        assert pytest.approx(10 + 12 * at_ms / 1000) == known(memory, message(at_ms)).items[0].X
    assert known(memory, message(MEMORY_MS + 50)).items == ()
    here = CAR._replace(X=14.0)
    known(memory, message(400, CAR))
    assert known(memory, message(450, here)).items == (here,)


def test_to_ask_again_for_the_same_message_changes_nothing(memory):
    known(memory, message(0, CAR))
    first = known(memory, message(100))
    assert known(memory, message(100)) == first


def test_a_clock_that_is_set_back_and_a_reset_forget_everything(memory):
    known(memory, message(100, CAR))
    assert known(memory, message(0)).items == ()
    known(memory, message(100, CAR))
    memory.reset()
    assert known(memory, message(150)).items == ()


@pytest.mark.parametrize('memory_s', [None, 0.0])
def test_without_a_memory_what_is_not_in_the_message_is_unknown_at_once(params, memory_s):
    memory = Seen(params, memory_s)
    known(memory, message(0, CAR))
    empty = message(50)
    assert known(memory, empty) is empty
