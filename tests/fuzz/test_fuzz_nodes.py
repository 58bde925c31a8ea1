"""No message crashes the plant or the scenario; the plant follows no invalid command."""

import hostile_messages
import node_bench
import numpy as np
import pytest
from example_messages import load_example
from hypothesis import given, settings
from hypothesis import strategies as st

from msgs_yaml import conformance, decode, encode
from msgs_yaml.types import Command
from node_runtime import ros
from vehicle_plant.gate import Gate

pytestmark = pytest.mark.ros
FUZZ = settings.get_profile('fuzz')
BATCH = 40  # per example
START_NS = 1_000_000_000
STEPS_NS = 5_000_000  # of the plant on the wall clock, between two of its messages
OBSTACLES, COMMAND, REFERENCE = '/scenario/obstacles', '/controller/command', '/scenario/reference'
# what every car might follow; this one follows less
WITHIN_THE_CONTRACT = st.tuples(
    st.floats(-1.2, 1.2), st.floats(-60_000.0, 60_000.0), st.floats(-60_000.0, 60_000.0)
) | st.tuples(st.floats(-0.1, 0.1), st.floats(-800.0, 0.0), st.floats(-800.0, 0.0))


BATCHES = st.lists(hostile_messages.changes(), min_size=BATCH, max_size=BATCH)


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
    @given(BATCHES, st.lists(WITHIN_THE_CONTRACT, min_size=BATCH // 2, max_size=BATCH // 2))
    def example(batch, sound):
        if plant.node.mode.stepper is None or plant.node.mode.stepper.outcome:
            begin(plant)
        mode = plant.node.mode
        for change in batch:  # to one that the plant waits for
            awaited = node_bench.command(mode.stepper.car.stamp_ns)
            node_bench.send(plant.node, COMMAND, hostile_messages.changed(awaited, change))
        for delta, Fxf, Fxr in sound:
            now_ns = mode.stepper.car.stamp_ns
            command = Command(now_ns, delta, 0.0, Fxf, Fxr)
            node_bench.send(plant.node, COMMAND, encode.command(command))
        if plant.mode == 'realtime':
            plant.bus.now_ns += STEPS_NS
            mode.on_step()
        for name in ('state', 'actuator', 'imu', 'wheel'):
            columns = getattr(mode.stepper.car.now, f'{name}_columns')()
            assert np.all(np.isfinite(np.hstack([np.ravel(values) for values in columns])))
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
    kept, sound = [plant.node.reference], load_example(REFERENCE)

    @FUZZ
    @given(BATCHES)
    def example(batch):
        for change in batch:
            node_bench.send(plant.node, REFERENCE, hostile_messages.changed(sound, change))
            if plant.node.reference is not kept[-1]:
                kept.append(plant.node.reference)
                assert np.isfinite(plant.node.simulator_at(START_NS).now.rows).all()

    example()
    assert len(kept) > 1


@pytest.mark.parametrize(
    ('mode', 'topic'), [('lockstep', '/clock'), ('realtime', '/vehicle/run_start')]
)
def test_the_scenario_survives_every_message_and_obeys_the_contract(mode, topic):
    """It hears the clock in lockstep, the start of the run on the wall clock."""
    with node_bench.running('scenario', mode) as scenario:
        sound, sent = load_example(topic), []
        scenario.bus.listeners[OBSTACLES] = [sent.append]
        node_bench.send(scenario.node, topic, sound)  # now there is something to say

        @FUZZ
        @given(BATCHES)
        def example(batch):
            for change in batch:
                raw = hostile_messages.changed(sound, change)
                node_bench.send(scenario.node, topic, raw)
            if mode == 'lockstep':
                node_bench.send(scenario.node, topic, sound)
            else:
                scenario.node.on_timer()
            assert sent
            for raw in sent:
                assert conformance.check(OBSTACLES, ros.deserialize(OBSTACLES, raw)) == []
            sent.clear()

        example()
