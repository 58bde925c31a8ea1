"""No message ends the controller, and none makes it say something that must not be said.

What a message leads to is counted: turned down or never used, answered by a solve, or by a rung of
the ladder below. Only what a solve answered has been through the whole controller.
"""

import hostile
import nodes
import pytest
import scenes
from answering import FALLBACK, SILENT, SOLVE, Driver, punctual
from hypothesis import given, settings
from hypothesis import strategies as st

# numbers that numpy warns of are no numbers to drive by
pytestmark = [pytest.mark.ros, pytest.mark.filterwarnings('error::RuntimeWarning')]
FUZZ = settings.get_profile('fuzz')
BATCH = 10  # inputs per example
SCENES = {'lockstep': 8, 'realtime': 40}  # per example
# of the scenes: others cannot be driven; on the wall clock a busy machine takes the solver's time
LEAST_SOLVED = {'lockstep': 0.3, 'realtime': 0.1}
ACTUATORS, ODOMETRY = '/vehicle/actuators', '/vehicle/odometry'
TOPICS = ('/scenario/reference', '/scenario/road_edges', '/scenario/obstacles', ACTUATORS, ODOMETRY)


# in realtime with the priority of SCHED_FIFO, where the user may give it
@pytest.fixture(
    scope='module', params=['lockstep', pytest.param('realtime', marks=pytest.mark.alone)]
)
def driver(request):
    with nodes.running('controller', request.param) as bench, punctual(request.param):
        driver = Driver(bench)
        driver.recover()
        yield driver


@pytest.mark.parametrize('topic', TOPICS)
def test_the_controller_outlives_every_message_and_solves_for_the_next_state(driver, topic, count):
    @FUZZ
    @given(st.lists(hostile.changes(), min_size=BATCH, max_size=BATCH))
    def told(changes):
        for change in changes:
            outcome = tell_hostile(driver, topic, change)
            count(topic, outcome=f'{outcome}, {driver.bench.mode}')
        driver.recover()

    told()


def tell_hostile(driver, topic, change):
    """Tell one hostile message among sound ones; return how the state of its tick was answered."""
    if topic == ACTUATORS:  # nobody asks for them but at a start
        driver.restart()
    stamp_ns = driver.next_tick()
    message = hostile.changed(nodes.sound(stamp_ns)[topic], change)
    if topic == ODOMETRY:
        driver.tell_sound(ODOMETRY)
        driver.tell(topic, message)
        answer, used = driver.look(), driver.node.inputs.state == message
        return answer.outcome if used else SILENT
    driver.tell_sound(*((ACTUATORS, ODOMETRY) if topic == ACTUATORS else (ODOMETRY,)))
    scene = driver.node.controller.scene
    driver.tell(topic, message)
    used = topic == ACTUATORS or driver.node.controller.scene is not scene
    driver.tell_sound(*(one for one in TOPICS if one != ODOMETRY))
    answer = driver.look()
    return answer.outcome if used else SILENT


def test_every_valid_situation_is_answered_and_enough_of_them_by_a_solve(driver, count):
    tried = {SOLVE: 0, FALLBACK: 0}

    @FUZZ
    @given(st.integers(0, 2**32 - 1))
    def told(seed):
        for number, scene in enumerate(scenes.scenes(seed, SCENES[driver.bench.mode])):
            if number % (2 * scenes.TICKS) == 0:  # every other scene begins with a cold solver
                driver.restart()
            stamp_ns = driver.next_tick()
            driver.tell(ACTUATORS, nodes.sound(stamp_ns)[ACTUATORS])
            for topic, message in scene.messages(stamp_ns).items():
                driver.tell(topic, message)
            answer = driver.look()
            assert answer.stamp_ns == stamp_ns, (answer, scene)
            tried[answer.outcome] += 1
            count('scene', outcome=f'{answer.outcome}, {driver.bench.mode}')
        driver.recover()

    told()
    assert tried[SOLVE] >= LEAST_SOLVED[driver.bench.mode] * sum(tried.values()), tried
