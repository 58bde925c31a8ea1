"""What paths and road edges cost the thread that receives them: a table of docs/performance.md."""

import time
from collections.abc import Callable
from timeit import repeat

import numpy as np
from tables import markdown, number

from mpcc_controller.path import compiled_queries, reference_path, road_edges
from msgs_yaml import encode, raw_scenario
from msgs_yaml.raw_scenario import REFERENCE, ROAD_EDGES
from msgs_yaml.types import Reference, RoadEdges
from node_runtime import ros, subscriptions_node

POSES = (50, 5_000, 40_000)  # and points of each edge; the contract allows the last
SPACING_M, SPEED_MPS, HALF_WIDTH_M = 0.5, 30.0, 3.5
STAMP_NS, LATER_NS = 5_000_000_003, 1_795_000_000_987_654_321
TIMES = 20


def main():
    """Print the least processor time of TIMES calls: other programs do not change it."""
    compiled_queries.library()  # a controller compiles it before the first message
    rows = [row for poses in POSES for row in _measure(poses)]
    columns = ('message', 'elements', 'kB', 'new ms', 'repeated ms', 'sent again ms')
    print(markdown('Processor time per message', columns, rows))


def _measure(poses):
    s = SPACING_M * (np.arange(poses) - 0.5 * poses)
    path = Reference(STAMP_NS, s, 0.0 * s, 0.0 * s, (s - s[0]) / SPEED_MPS)
    left, right = (np.column_stack([s, 0.0 * s + y]) for y in (HALF_WIDTH_M, -HALF_WIDTH_M))

    def use_path(raw):
        return reference_path.build(subscriptions_node.read_reference(raw))

    def use_edges(raw):
        return road_edges.build(subscriptions_node.read_road_edges(raw))

    edges = encode.road_edges(RoadEdges(STAMP_NS, left, right))
    restamp = raw_scenario.restamp_reference, raw_scenario.restamp_road_edges
    yield _row(REFERENCE, poses, encode.reference(path), use_path, restamp[0])
    yield _row(ROAD_EDGES, poses, edges, use_edges, restamp[1])


def _row(topic, count, message, use, restamp):
    raw = ros.serialize(message)
    later = restamp(raw, LATER_NS)
    calls: list[Callable[[], object]] = [
        lambda: use(raw),
        lambda: raw_scenario.repeated_ns(topic, later, raw),
        lambda: restamp(raw, LATER_NS),
    ]
    times = [
        number(1e3 * min(repeat(call, number=1, repeat=TIMES, timer=time.thread_time)))
        for call in calls
    ]
    return topic, f'{count:,}', f'{len(raw) / 1e3:,.0f}', *times


if __name__ == '__main__':
    main()
