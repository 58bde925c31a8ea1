"""Shows the running nodes to Foxglove: every topic of the contract, as raw bytes."""

import sys
from functools import partial

from rclpy.node import Node

from bags.errors import BagError
from bags.storage.message_filing import bag_topics
from bags.viewers.foxglove_server import PORT, Server, connection_hint
from bags.viewers.marker_scene import STATE, MarkerScene, ShapeParams
from msgs_yaml import contract, decode, share
from node_runtime import help_node, ros, spin_node
from node_runtime.parameters import ParameterError

REALTIME = 'realtime'  # its QoS serves both modes
THROTTLE_S = 1.0


class ViewNode(Node):
    """Forwards the topics it subscribes to; it slows no publisher and may lose messages."""

    def __init__(self, port: int):
        super().__init__('view')
        defaults = share.path('bags', 'config', 'markers.yaml')
        params = ros.declare(self, ShapeParams, defaults)
        known = contract.load().topics
        topics = [t for t in bag_topics(contract.load(), REALTIME) if not known[t.name].on_request]
        try:
            self.server = Server(topics, port, MarkerScene(params))
        except BagError as error:
            raise ParameterError(str(error)) from error
        self.now_ns = 0
        for topic in topics:
            profile = ros.observer_profile(known[topic.name], REALTIME)
            callback, kind = partial(self.on_message, topic), ros.message_type(topic.name)
            self.create_subscription(
                kind, ros.relative_name(topic.name), callback, profile, raw=True
            )
        print(connection_hint(self.server.url), flush=True)

    def on_message(self, topic, raw):
        """Forward a message; the time is that of the last state, in both modes."""
        if topic.name == STATE:
            try:
                self.now_ns = decode.stamp_ns_of(raw)
            except decode.DecodeError as error:
                text = f'{topic.name}: {error}'
                self.get_logger().warning(text, throttle_duration_sec=THROTTLE_S)
                return
            self.server.broadcast_time(self.now_ns)
        self.server.forward(topic, raw, self.now_ns)

    def close(self):
        """End the server."""
        self.server.close()


def main() -> int:
    """Serve until SIGINT or SIGTERM."""
    parser = help_node.parser(__doc__, '--port 8766 --ros-args -r __ns:=/car1')
    parser.add_argument(
        '--port', type=int, default=PORT, help='of the server (default: %(default)s)'
    )
    return spin_node.spin(partial(ViewNode, help_node.parse(parser).port))


if __name__ == '__main__':
    sys.exit(main())
