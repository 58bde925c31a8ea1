"""The messages of the whole node graph as bytes, for each millisecond, for the bag benchmark."""

import struct
from collections.abc import Iterator

import numpy as np
from rclpy.serialization import serialize_message

from msgs_yaml import contract, encode, flat_fields, types

START_NS = 1_234_567_890_000  # its bytes are nothing else in a message
NS_PER_MS = 1_000_000
MS_PER_S = 1000
STATE = ('/vehicle/odometry', '/vehicle/actuators', '/vehicle/imu', '/vehicle/wheels')
STAMP_AT = 4  # after the encapsulation header
FOUR = (1.0, 2.0, 3.0, 4.0)


def _constant():
    """One message of every topic that is not patched number by number."""
    t = np.arange(51) * 0.05
    x = 20.0 * t
    edges = np.column_stack([x, x * 0.0 + 3.0])
    values = {f'cost.term{k}': 0.1 * k for k in range(40)}
    made = {
        '/scenario/reference': encode.reference(types.Reference(START_NS, x, 0 * x, 0 * x, t)),
        '/scenario/road_edges': encode.road_edges(types.RoadEdges(START_NS, edges, edges - 6.0)),
        '/scenario/obstacles': encode.obstacles(
            types.Obstacles(START_NS, (types.Obstacle(1, 40.0, 1.5, 1.0, -5.0, 0.0),))
        ),
        '/controller/stop_plan': encode.stop_plan(types.StopPlan(START_NS, t + 0.2, 0 * x, -x, -x)),
        '/controller/prediction': encode.prediction(types.Prediction(START_NS, x, 0 * x, 0 * x, t)),
        '/controller/why': encode.why(types.Why(START_NS, 0, '', {'rung': 'solved'} | values)),
        '/diagnostics': encode.health(types.Health(START_NS, 'plant', 0, 'drives', values)),
        '/clock': encode.clock(START_NS),
    }
    return {topic: bytes(serialize_message(message)) for topic, message in made.items()}


class GraphMessages:
    """What plant, scenario and controller send, with rising stamps and changing states."""

    def __init__(self, mode: str, every_ms: bool):
        """`every_ms`: imu and wheels come at 1 kHz, too, not at the contract's rate."""
        self._templates = {topic: flat_fields.load(topic) for topic in flat_fields.TYPES}
        self._constant = _constant()
        self.topics = tuple(contract.load().topics.values())
        self._period_ms = [
            1 if every_ms and topic.name in STATE else _period_ms(topic.rate_hz[mode])
            for topic in self.topics
        ]

    def at(self, ms: int) -> Iterator[tuple[int, bytes]]:
        """Yield the index and the CDR of every message of a millisecond."""
        stamp_ns = START_NS + ms * NS_PER_MS
        for index, (topic, period) in enumerate(zip(self.topics, self._period_ms)):
            if period and ms % period == 0:
                yield index, self._data(topic, stamp_ns)

    def _data(self, topic, stamp_ns):
        if topic.name in self._templates:
            return self._templates[topic.name].fill(_value(topic.name, stamp_ns))
        data, stamp = self._constant[topic.name], _bytes(stamp_ns)
        if topic.type.endswith('MarkerArray'):
            return data.replace(_bytes(START_NS), stamp)  # every marker has one
        return data[:STAMP_AT] + stamp + data[STAMP_AT + len(stamp) :]


def _bytes(stamp_ns):
    return struct.pack('<iI', *divmod(stamp_ns, 10**9))


def _period_ms(rate_hz):
    return round(MS_PER_S / rate_hz) if rate_hz else 0


def _value(topic, stamp_ns):
    """Return a state that never repeats, so that compression finds no more than on a real drive."""
    s = stamp_ns * 1e-9
    wave = float(np.sin(s))
    if topic == '/vehicle/odometry':
        return types.VehicleState(
            stamp_ns, 20.0 * s, wave, 0.1 * wave, 20.0 - wave, wave, 0.3 * wave
        )
    if topic == '/vehicle/imu':
        return types.Imu(stamp_ns, 3.0 * wave, -5.0 * wave, 0.3 * wave)
    if topic == '/vehicle/wheels':
        loads = (4e3 + 100 * wave, 4e3 - 100 * wave, 3e3 + 90 * wave, 3e3 - 90 * wave)
        return types.Wheels(stamp_ns, FOUR, FOUR, loads, FOUR, loads, FOUR, loads)
    if topic == '/vehicle/actuators':
        return types.Actuators(stamp_ns, 0.01 * wave, 0.1 * wave, -2e3 * wave, -1e3 * wave, FOUR)
    return types.Command(stamp_ns, 0.01 * wave, 0.1 * wave, -2e3 * wave, -1e3 * wave)
