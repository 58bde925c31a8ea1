import pytest

from msgs_yaml import contract
from scenario_publisher import scenario
from scenario_publisher.scenario import START_NS
from scenario_publisher.timeline import NAME, RateLimiter, Timeline

MOVING = scenario.load('moving_obstacle')
MS = 1_000_000


@pytest.mark.parametrize(
    ('given_ms', 'due_ms'),
    [
        (range(0, 1001, 50), [0, 250, 500, 750, 1000]),
        # a gap is followed by one beat, and then by the rate again
        ([0, 1010, 1060, 1110, 1160, 1210, 1260, 1310, 1510], [0, 1010, 1260, 1510]),
        # a repeated stamp is not repeated, a jump back is followed
        ([700, 700, 0], [700, 0]),
    ],
)
def test_a_beat_is_due_at_first_and_then_once_per_period(given_ms, due_ms):
    beat = RateLimiter(4.0)
    assert [ms for ms in given_ms if beat.is_due(START_NS + ms * MS)] == due_ms


def test_late_stamps_do_not_lower_the_rate():
    # a clock of 20 Hz whose stamps waver by 1 ms, for a minute: 4 Hz are 240 beats
    beat = RateLimiter(4.0)
    stamps = [START_NS + (tick * 50 + tick % 3 - 1) * MS for tick in range(1, 1201)]
    assert sum(beat.is_due(stamp) for stamp in stamps) == 240


def test_a_plant_that_was_started_again_begins_another_run():
    timeline = Timeline(MOVING, 'realtime')
    timeline.update_run_start(80 * START_NS)
    timeline.update_run_start(0)
    (held,) = timeline.obstacles(90 * START_NS).items
    assert pytest.approx(60.0) == held.X


def test_contract_and_node_agree_on_its_name():
    topics = contract.load().topics.values()
    ours = [topic.publisher for topic in topics if topic.name.startswith('/scenario/')]
    assert ours == [NAME] * 4
