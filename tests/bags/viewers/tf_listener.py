"""Prints the transforms of /tf, one line of JSON each, until there are as many as asked for."""

import json
import sys

import rclpy
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage

from node_runtime import spin_node

DEPTH = 100  # what tf2 listeners use


def main() -> None:
    """Listen; reliable, as tf2 does."""
    rclpy.init()
    node = rclpy.create_node('tf_listener')
    result = []
    node.create_subscription(
        TFMessage, '/tf', lambda message: result.extend(message.transforms), QoSProfile(depth=DEPTH)
    )
    while len(result) < int(sys.argv[1]):
        rclpy.spin_once(node, timeout_sec=0.5)
    for item in result:
        stamp, place, turn = item.header.stamp, item.transform.translation, item.transform.rotation
        text = {
            'frames': [item.header.frame_id, item.child_frame_id],
            'stamp_ns': stamp.sec * 1_000_000_000 + stamp.nanosec,
            'at': [place.x, place.y, place.z],
            'turn': [turn.x, turn.y, turn.z, turn.w],
        }
        print(json.dumps(text))
    spin_node.shut_down(node)


if __name__ == '__main__':
    main()
