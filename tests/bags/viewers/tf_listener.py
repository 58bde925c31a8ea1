"""Prints transforms, one line of JSON each, until there are as many as asked for.

`tf_listener.py COUNT [TOPIC]`: of /tf, or of the latched /tf_static.
"""

import json
import sys

import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

from node_runtime import spin_node

DEPTH = 100  # what tf2 listeners use


def main() -> None:
    """Listen; reliable, as tf2 does."""
    count, topic = int(sys.argv[1]), (sys.argv[2:] or ['/tf'])[0]
    latched = DurabilityPolicy.TRANSIENT_LOCAL if topic == '/tf_static' else None
    profile = QoSProfile(depth=DEPTH, durability=latched or DurabilityPolicy.VOLATILE)
    rclpy.init()
    node = rclpy.create_node('tf_listener')
    arrived, printed = [], 0
    node.create_subscription(
        TFMessage, topic, lambda message: arrived.extend(message.transforms), profile
    )
    while printed < count:
        rclpy.spin_once(node, timeout_sec=0.5)
        _print(arrived)
        printed += len(arrived)
        arrived.clear()
    spin_node.shut_down(node)


def _print(items):
    for item in items:
        stamp, place, turn = item.header.stamp, item.transform.translation, item.transform.rotation
        text = {
            'frames': [item.header.frame_id, item.child_frame_id],
            'stamp_ns': stamp.sec * 1_000_000_000 + stamp.nanosec,
            'at': [place.x, place.y, place.z],
            'turn': [turn.x, turn.y, turn.z, turn.w],
        }
        print(json.dumps(text), flush=True)


if __name__ == '__main__':
    main()
