"""No message ends the plant, and no absurd one is followed."""

import nodes
import numpy as np
import pytest
from hypothesis import given, settings
from telling import batches, tell_all

from msgs_yaml import decode, stamp

pytestmark = pytest.mark.ros
DOMAIN = 82
START_NS = 1_000_000_000
FUZZ = settings.get_profile('fuzz')


@pytest.fixture(params=['lockstep', 'realtime'])
def plant(request):
    with nodes.running('plant', request.param, DOMAIN) as bench:
        yield bench


def begin(bench):
    """Start a run of a plant, which drives once; on the wall clock a command must let it go."""
    if bench.node.drive.ring is not None:
        bench.renew()
    nodes.tell_facts(bench.node, START_NS)
    bench.node.drive.begin()
    if bench.mode == 'realtime':
        bench.node.drive.let_go(decode.command(nodes.command(START_NS)))


def test_the_plant_outlives_every_command_and_follows_none_that_is_absurd(plant, count):
    topic = '/controller/command'

    @FUZZ
    @given(batches(topic))
    def told(batch):
        if plant.node.drive.ring is None or plant.node.drive.ring.outcome:
            begin(plant)
        drive = plant.node.drive
        for message in batch[0]:  # that the plant waits for, but for what is wrong with them
            sec, nanosec = stamp.split(drive.ring.car.stamp_ns)
            message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
        tell_all(plant, topic, batch, count)
        if plant.mode == 'realtime':
            drive.on_step()
        for name in ('odometry', 'actuators', 'imu', 'wheels'):
            now = drive.ring.car.now
            (value,) = now.states() if name == 'odometry' else getattr(now, name)()
            assert np.all(np.isfinite(np.hstack(value)))

    told()


def test_the_plant_outlives_every_path_and_starts_on_none_that_is_absurd(plant, count):
    topic = '/scenario/reference'
    nodes.tell_facts(plant.node, START_NS)
    kept = [plant.node.reference]

    @FUZZ
    @given(batches(topic))
    def told(batch):
        messages, raws = batch
        for one in [([message], []) for message in messages] + [([], [raw]) for raw in raws]:
            tell_all(plant, topic, one, count)
            if plant.node.reference is not kept[-1]:
                kept.append(plant.node.reference)
                assert np.isfinite(plant.node.car_at(START_NS).now.rows).all()

    told()
    assert len(kept) > 1
