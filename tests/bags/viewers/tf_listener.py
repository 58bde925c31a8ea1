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
    found = []
    node.create_subscription(
        TFMessage, '/tf', lambda message: found.extend(message.transforms), QoSProfile(depth=DEPTH)
    )
    while len(found) < int(sys.argv[1]):
        rclpy.spin_once(node, timeout_sec=0.5)
    for one in found:
        stamp, place, turn = one.header.stamp, one.transform.translation, one.transform.rotation
        told = {
            'frames': [one.header.frame_id, one.child_frame_id],
            'stamp_ns': stamp.sec * 1_000_000_000 + stamp.nanosec,
            'at': [place.x, place.y, place.z],
            'turn': [turn.x, turn.y, turn.z, turn.w],
        }
        print(json.dumps(told))
    spin_node.shut_down(node)


if __name__ == '__main__':
    main()
