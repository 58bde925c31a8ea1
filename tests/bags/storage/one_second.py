"""One second of driving as every node sends it, a bag of it, and what of it a bag holds."""

import itertools

import numpy as np
from example_messages import encoded

from bags.storage import message_filing, read
from bags.storage.bag_writer import BagWriter
from msgs_yaml import contract, types
from node_runtime import ros

START_NS = 1_000_000_000
TICK_NS = 50_000_000
TICKS = 20
FOUR = (1.0, 2.0, 3.0, 4.0)
SLIPS = (0.1, -0.2, 0.3, -0.4)


def every_message():
    """One second of driving: {topic: [value, ...]}, no number equal to its neighbour."""
    ticks = [START_NS + k * TICK_NS for k in range(TICKS)]
    steps = [START_NS + k * 1_000_000 for k in range(TICKS * 50)]
    t = np.arange(51) * 0.05
    X = 20.0 * t
    ahead = np.arange(51) / 16.0  # numbers of 32 bits hold it
    covariance = np.zeros((51, 2, 2)) + np.diag([0.5, 0.25])
    return {
        '/scenario/reference': [types.Reference(START_NS, X, 0.1 * X, 0.01 * X, t)],
        '/scenario/road_edges': [
            types.RoadEdges(
                START_NS, np.column_stack([X, X * 0 + 3.5]), np.column_stack([X, X * 0 - 2.5])
            )
        ],
        '/scenario/obstacles': [
            types.Obstacles(
                ns,
                (
                    types.Obstacle(1, 40.0, 1.5, 1.0, 0.0, 0.0),
                    types.Obstacle(2, 60.0 - k, 2.5, 0.5, -20.0, 0.0),
                ),
            )
            for k, ns in enumerate(ticks)
        ],
        '/vehicle/odometry': [
            # the heading passes pi: half of them come out negative
            types.VehicleState(ns, 0.02 * k, -1.5 + 0.001 * k, 3.0 + 3e-4 * k, 20.0, 0.1, 1e-3 * k)
            for k, ns in enumerate(steps)
        ],
        '/vehicle/actuators': [
            types.Actuators(ns, 1e-4 * k, -0.1, -2.0 * k, -1.0 * k, FOUR)
            for k, ns in enumerate(steps)
        ],
        '/scenario/predictions': [
            types.Predictions(
                ns, {2: (types.Branch(ns, 0.5, ahead, 60.0 - k - ahead, ahead, covariance),)}
            )
            for k, ns in enumerate(ticks)
        ],
        '/vehicle/imu': [types.Imu(ns, 0.1 * k, -0.2 * k, 0.3) for k, ns in enumerate(steps[::10])],
        '/vehicle/wheels': [
            types.Wheels(ns, FOUR, FOUR, (4e3 + k, 3e3, 2e3, 1e3), SLIPS, FOUR, SLIPS[::-1], FOUR)
            for k, ns in enumerate(steps[::10])
        ],
        '/sensors/inertial': [
            types.Inertial(ns, 0.2 * k, -0.1 * k, 0.4) for k, ns in enumerate(steps[::10])
        ],
        '/sensors/chassis': [types.Chassis(ns, 0.01 * k, FOUR) for k, ns in enumerate(steps[::10])],
        '/sensors/gnss': [
            types.Gnss(ns, 2.0 * k, 0.5 * k, 20.0, 0.1) for k, ns in enumerate(steps[::50])
        ],
        '/estimator/odometry': [
            types.EstimatedState(
                *(ns, 0.2 * k, 0.01 * k, 0.003 * k, 20.0, 0.1, 1e-3 * k),
                *(1e-4 * (j + k) for j in range(12)),
            )
            for k, ns in enumerate(steps[::10])
        ],
        '/controller/command': [
            types.Command(ns, 0.01 * k, 0.2, -100.0 * k, -50.0) for k, ns in enumerate(ticks)
        ],
        '/controller/stop_plan': [
            types.StopPlan(ns, 0.2 + t, 0.01 * k - 0.1 * t, -100.0 * k - X, -50.0 - X)
            for k, ns in enumerate(ticks)
        ],
        '/controller/prediction': [
            types.Prediction(ns, X + k, 0.5 * X, 0.02 * X, t) for k, ns in enumerate(ticks)
        ],
        '/controller/why': [
            types.Why(ns, 0, 'solved', {'rung': 'solved', 'cost.con': 0.1 * k, 'iterations': k})
            for k, ns in enumerate(ticks)
        ],
        '/diagnostics': [types.Health(START_NS, 'plant', 0, 'drives', {'ticks': TICKS})],
        '/vehicle/run_start': [START_NS],
        '/clock': ticks,
    }


TOPICS = {
    name: message_filing.bag_topic(topic, 'lockstep')
    for name, topic in contract.load().topics.items()
}


def recording(topic, payloads, log_ns=None, publish_ns=None):
    """Return the recording of messages of a topic; what is no bytes is serialised."""
    payloads = [item if isinstance(item, bytes) else ros.serialize(item) for item in payloads]
    times = np.arange(len(payloads), dtype=np.int64) if log_ns is None else np.array(log_ns)
    sent = times if publish_ns is None else np.array(publish_ns)
    return read.Recording(TOPICS[topic], times, sent, 1 + np.arange(len(payloads)), payloads)


def in_memory(*recordings, path='made up'):
    """Return a bag of recordings that is in no file."""
    named = {recorded.topic.name: recorded for recorded in recordings}
    return read.Bag(path, (), named, {}, None)


def write_recordings(folder, recordings, entries, **split):
    """Write a bag of recordings, in the order of time; return its folder."""
    writer = BagWriter(folder, [r.topic for r in recordings], {'run': entries}, **split)
    rows = [
        (log_ns, index, publish_ns, data, sequence)
        for index, r in enumerate(recordings)
        for log_ns, publish_ns, data, sequence in zip(
            r.log_ns.tolist(), r.publish_ns.tolist(), r.payloads, r.sequence.tolist()
        )
    ]
    for k, (log_ns, index, *others) in enumerate(sorted(rows, key=lambda row: row[:2])):
        writer.write(index, log_ns, *others)
        if k % 100 == 0:
            writer.flush()
    writer.close()
    return folder


def write(folder, messages, entries):
    """Write a bag as a recorder files these messages in lockstep, without any node."""
    silent = {topic: recording(topic, []) for topic in TOPICS}
    recordings = {}
    for topic, sent in messages.items():
        stamps_ns = np.array([getattr(value, 'stamp_ns', value) for value in sent])
        payloads = [ros.serialize(encoded(topic, value)) for value in sent]
        # the middleware fills up to four bytes
        payloads = [data + bytes(-len(data) % 4) for data in payloads]
        recordings[topic] = recording(topic, payloads, stamps_ns, 2 * START_NS + stamps_ns)
    write_recordings(folder, (silent | recordings).values(), entries)


def endless(values):
    """The same values again and again, with stamps that go on."""
    step_ns = values[1].stamp_ns - values[0].stamp_ns
    for k, value in enumerate(itertools.cycle(values)):
        yield value._replace(stamp_ns=values[0].stamp_ns + k * step_ns)


def counts(folder):
    """Return how many messages of each topic a bag holds, where there are any."""
    return {name: len(recorded.payloads) for name, recorded in of_contract(folder).items()}


def of_contract(folder):
    """Return the recordings of the topics of the contract that have messages."""
    recordings = read.load(folder).recordings
    known = contract.load().topics
    return {name: r for name, r in recordings.items() if r.payloads and name in known}


def expected(messages):
    return {topic: len(sent) for topic, sent in messages.items()}
