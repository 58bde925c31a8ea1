"""No message crashes the plant, and it follows no invalid command."""

import node_bench
import numpy as np
import pytest
from batches import BATCH, batches, send_all
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_yaml import conversions, decode, encode
from msgs_yaml.types import Command
from vehicle_plant.gate import Gate

pytestmark = pytest.mark.ros
START_NS = 1_000_000_000
# what every car might follow; this one follows less
WITHIN_THE_CONTRACT = st.tuples(
    st.floats(-1.2, 1.2), st.floats(-60_000.0, 60_000.0), st.floats(-60_000.0, 60_000.0)
) | st.tuples(st.floats(-0.1, 0.1), st.floats(-800.0, 0.0), st.floats(-800.0, 0.0))
FUZZ = settings.get_profile('fuzz')


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


def test_the_plant_survives_every_command_and_follows_no_invalid_one(plant, followed, count):
    topic = '/controller/command'
    taken, refused = [], []  # how many, batch by batch

    @FUZZ
    @given(batches(topic), st.lists(WITHIN_THE_CONTRACT, min_size=BATCH, max_size=BATCH))
    def example(batch, sound):
        if plant.node.mode.stepper is None or plant.node.mode.stepper.outcome:
            begin(plant)
        mode = plant.node.mode
        for message in batch[0]:  # that the plant waits for, but for what is wrong with them
            sec, nanosec = conversions.split_stamp(mode.stepper.car.stamp_ns)
            message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
        send_all(plant, topic, batch, count)
        for delta, Fxf, Fxr in sound:
            now_ns = mode.stepper.car.stamp_ns
            message = encode.command(Command(now_ns, delta, 0.0, Fxf, Fxr))
            node_bench.send(plant.node, topic, message)
            count(topic)
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
            one = followed.pop()
            assert np.all(np.isfinite(one))
            assert one.stamp_ns <= mode.stepper.car.stamp_ns
            assert abs(one.delta) <= car.steering.limit_rad + car.gate.steer_tolerance_rad
            for force, axle in ((one.Fxf, car.force.front), (one.Fxr, car.force.rear)):
                most = car.gate.force_tolerance_n
                assert -axle.brake_n - most <= force <= axle.drive_n + most

    example()
    assert sum(taken) > 0
    assert max(refused) > 0


def test_the_plant_survives_every_path_and_starts_on_no_invalid_one(plant, count):
    topic = '/scenario/reference'
    node_bench.send_path(plant.node, START_NS)
    kept = [plant.node.reference]

    @FUZZ
    @given(batches(topic))
    def example(batch):
        messages, raws = batch
        for one in [([message], []) for message in messages] + [([], [raw]) for raw in raws]:
            send_all(plant, topic, one, count)
            if plant.node.reference is not kept[-1]:
                kept.append(plant.node.reference)
                assert np.isfinite(plant.node.simulator_at(START_NS).now.rows).all()

    example()
    assert len(kept) > 1
