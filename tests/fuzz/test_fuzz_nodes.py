"""No message crashes the plant or the scenario; the plant follows no invalid command."""

import time

import hostile_messages
import node_bench
import numpy as np
import pytest
from example_messages import load_example
from hypothesis import given, settings
from hypothesis import strategies as st
from wait_until import wait_until

from msgs_yaml import conformance, conversions, decode, encode
from msgs_yaml.types import Command
from node_runtime import ros
from vehicle_plant.gate import Gate

pytestmark = pytest.mark.ros
FUZZ = settings.get_profile('fuzz')
BATCH = 20  # of each kind per example
START_NS = 1_000_000_000
PATIENCE_S = 60.0
OBSTACLES, COMMAND, REFERENCE = '/scenario/obstacles', '/controller/command', '/scenario/reference'
# what every car might follow; this one follows less
WITHIN_THE_CONTRACT = st.tuples(
    st.floats(-1.2, 1.2), st.floats(-60_000.0, 60_000.0), st.floats(-60_000.0, 60_000.0)
) | st.tuples(st.floats(-0.1, 0.1), st.floats(-800.0, 0.0), st.floats(-800.0, 0.0))


def batches(topic):
    """Return a strategy of several hostile messages, as messages and as bytes."""
    return st.tuples(
        st.lists(hostile_messages.messages(topic), min_size=BATCH, max_size=BATCH),
        st.lists(hostile_messages.raws(topic), min_size=BATCH, max_size=BATCH),
    )


def send_all(bench, topic, messages, raws=()):
    """Send messages, and bytes; typed subscriptions get only bytes that deserialize."""
    receiver = node_bench.subscription(bench.node, topic)
    for message in messages:
        receiver.callback(ros.serialize(message) if receiver.raw else message)
    for raw in raws:
        try:
            receiver.callback(raw if receiver.raw else ros.deserialize(topic, raw))
        except ros.DecodeError:
            assert not receiver.raw  # the middleware drops what is typed


@pytest.fixture(params=['lockstep', 'realtime'])
def plant(request):
    with node_bench.running('plant', request.param) as bench:
        yield bench


def begin(bench):
    """Start a run of a plant, which drives once; on the wall clock a command must let it go."""
    if bench.node.mode.stepper is not None:
        bench.renew()
    node_bench.send_path(bench.node, START_NS)
    bench.node.mode.begin()
    if bench.mode == 'realtime':
        bench.node.mode.start_run(decode.command(node_bench.command(START_NS)))


@pytest.fixture
def followed(monkeypatch):
    """Every command that passed the gate of the plant."""
    passed, check = [], Gate.check

    def checked(gate, command, *now):
        verdict = check(gate, command, *now)
        if verdict.accepted:
            passed.append(command)
        return verdict

    monkeypatch.setattr(Gate, 'check', checked)
    return passed


def test_the_plant_survives_every_command_and_follows_no_invalid_one(plant, followed):
    taken, refused = [], []  # how many, batch by batch

    @FUZZ
    @given(batches(COMMAND), st.lists(WITHIN_THE_CONTRACT, min_size=BATCH, max_size=BATCH))
    def example(batch, sound):
        if plant.node.mode.stepper is None or plant.node.mode.stepper.outcome:
            begin(plant)
        mode = plant.node.mode
        for message in batch[0]:  # that the plant waits for, but for what is wrong with them
            sec, nanosec = conversions.split_stamp(mode.stepper.car.stamp_ns)
            message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
        send_all(plant, COMMAND, *batch)
        for delta, Fxf, Fxr in sound:
            now_ns = mode.stepper.car.stamp_ns
            send_all(plant, COMMAND, [encode.command(Command(now_ns, delta, 0.0, Fxf, Fxr))])
        if plant.mode == 'realtime':
            mode.on_step()
        for name in ('odometry', 'actuators', 'imu', 'wheels'):
            now = mode.stepper.car.now
            (value,) = now.states() if name == 'odometry' else getattr(now, name)()
            assert np.all(np.isfinite(np.hstack(value)))
        car = plant.node.plant.car
        refused.append(mode.stepper.car.gate.rejected)
        taken.append(len(followed))
        assert abs(mode.stepper.car.actuators.delta) <= car.steering.limit_rad + 1e-9
        while followed:
            command = followed.pop()
            assert np.all(np.isfinite(command))
            assert command.stamp_ns <= mode.stepper.car.stamp_ns
            assert abs(command.delta) <= car.steering.limit_rad + car.gate.steer_tolerance_rad
            for force, axle in ((command.Fxf, car.force.front), (command.Fxr, car.force.rear)):
                most = car.gate.force_tolerance_n
                assert -axle.brake_n - most <= force <= axle.drive_n + most

    example()
    assert sum(taken) > 0
    assert max(refused) > 0


def test_the_plant_survives_every_path_and_starts_on_no_invalid_one(plant):
    node_bench.send_path(plant.node, START_NS)
    kept = [plant.node.reference]

    @FUZZ
    @given(batches(REFERENCE))
    def example(batch):
        messages, raws = batch
        for one in [([message], []) for message in messages] + [([], [raw]) for raw in raws]:
            send_all(plant, REFERENCE, *one)
            if plant.node.reference is not kept[-1]:
                kept.append(plant.node.reference)
                assert np.isfinite(plant.node.simulator_at(START_NS).now.rows).all()

    example()
    assert len(kept) > 1


@pytest.mark.parametrize('mode', ['lockstep', 'realtime'])
def test_the_scenario_survives_every_message_and_obeys_the_contract(mode):
    """It hears the clock in lockstep, the start of the run on the wall clock."""
    with node_bench.running('scenario', mode) as scenario:
        (receiver,) = scenario.subscriptions()
        topic = receiver.topic_name
        sound = load_example(topic)
        if receiver.raw:
            sound = ros.serialize(sound)
        receiver.callback(sound)  # now there is something to say

        @FUZZ
        @given(batches(topic))
        def example(batch):
            send_all(scenario, topic, *batch)
            wait_until(
                lambda: not ros.missing_subscriptions(scenario.node, {OBSTACLES: 1}),
                PATIENCE_S,
                'no subscription',
            )
            receiver.callback(sound) if mode == 'lockstep' else scenario.node.on_timer()
            for name, message in wait_until(
                scenario.drain, PATIENCE_S, 'no message', lambda: time.sleep(0.001)
            ):
                assert conformance.check(name, message) == []

        example()
