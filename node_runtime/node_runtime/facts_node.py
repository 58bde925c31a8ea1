"""Path, road edges and obstacles from their serialised messages, in bounded time.

A message of any size may come, and the node that reads it has a command to send every 50 ms.
"""

from msgs_yaml import contract, decode, raw_edges, raw_path
from msgs_yaml.types import Obstacles, Reference, RoadEdges
from node_runtime import ros

REFERENCE, EDGES, OBSTACLES = raw_path.TOPIC, raw_edges.TOPIC, '/scenario/obstacles'
_COUNT = slice(4, 8)  # of a serialised MarkerArray, behind the encapsulation: how many there are
# of one marker without points at most, of one point
_MARKER_BYTES, _POINT_BYTES = 1000, 24


def read_reference(raw: bytes) -> Reference:
    """Return the path of a serialised /scenario/reference.

    Raises DecodeError, also and at once when it is longer than the contract allows. So do the
    others here.
    """
    most = contract.load().topics[REFERENCE].sizes['poses'].high
    if len(raw) > raw_path.size(most):
        allowed = f'allowed {raw_path.size(most)}, those of {most} poses'
        raise decode.DecodeError(f'{REFERENCE}: {len(raw)} bytes; {allowed}')
    found = raw_path.read(raw)
    return decode.reference(ros.message(REFERENCE, raw)) if found is None else found


def read_edges(raw: bytes) -> RoadEdges:
    """Return the edges of a serialised /scenario/road_edges."""
    _check_size(EDGES, raw)
    found = raw_edges.read(raw)
    return decode.road_edges(ros.message(EDGES, raw)) if found is None else found


def read_obstacles(raw: bytes) -> Obstacles:
    """Return the obstacles of a serialised /scenario/obstacles."""
    _check_size(OBSTACLES, raw)
    return decode.obstacles(ros.message(OBSTACLES, raw))


def _check_size(topic: str, raw: bytes) -> None:
    sizes = contract.load().topics[topic].sizes
    most = sizes['markers'].high
    points = max(allowed.high for key, allowed in sizes.items() if key.endswith('.points'))
    largest = most * (_MARKER_BYTES + _POINT_BYTES * points)
    is_little = raw[1:2] and raw[1] & 1
    count = int.from_bytes(raw[_COUNT], 'little' if is_little else 'big')
    if count > most:
        raise decode.DecodeError(f'{topic}: markers is {count} long; allowed {most} at most')
    if len(raw) > largest:
        raise decode.DecodeError(f'{topic}: {len(raw)} bytes; allowed {largest}')
