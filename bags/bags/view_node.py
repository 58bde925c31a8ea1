"""Shows the running ring to Foxglove: every topic of the contract, as it comes over the wire."""

import argparse
import sys
from functools import partial

from rclpy.node import Node
from rclpy.utilities import remove_ros_args

from bags.errors import BagError
from bags.storage.message_definitions import schema_text
from bags.viewers import marker_scene
from bags.viewers.foxglove_server import PORT, Forwarder, Served, Server, connection_hint
from bags.viewers.marker_scene import STATE, MarkerScene
from msgs_yaml import contract, decode, share
from node_runtime import ros, spin_node
from node_runtime.parameters import ParameterError

THROTTLE_S = 1.0
LATCHED = 'transient_local'


class ViewNode(Node):
    """Passes on what it hears; it slows nobody, and loses what it has no time for."""

    def __init__(self, port: int):
        super().__init__('view')
        defaults = share.path('bags', 'config', 'markers.yaml')
        params = ros.declare(self, marker_scene.ShapeParams, defaults)
        topics = contract.load().topics.values()
        self.schemas = {topic.type: schema_text(topic.type) for topic in topics}
        heard = [topic for topic in topics if not topic.on_request]
        try:
            self.server = Server([self._served(topic) for topic in heard], port)
        except BagError as error:
            raise ParameterError(str(error)) from error
        self.projector = Forwarder(self.server, MarkerScene(params))
        self.now_ns = 0
        for topic in heard:
            offered = topic.qos['realtime']
            callback, kind = partial(self.on_message, topic), ros.message_type(topic.name)
            self.create_subscription(
                kind,
                ros.relative_name(topic.name),
                callback,
                ros.observer_profile(offered),
                raw=True,
            )
        print(connection_hint(self.server.url), flush=True)

    def _served(self, topic):
        latched = topic.qos['realtime'].durability == LATCHED
        return Served(topic.name, topic.type, self.schemas[topic.type], latched)

    def on_message(self, topic, raw):
        """Pass a message on; the time of the ring is that of its states, in both modes."""
        if topic.name == STATE:
            try:
                self.now_ns = decode.stamp_ns_of(raw)
            except decode.DecodeError as error:
                told = f'{topic.name}: {error}'
                self.get_logger().warning(told, throttle_duration_sec=THROTTLE_S)
                return
            self.server.tell_time(self.now_ns)
        self.projector.show(topic.name, topic.type, self.schemas[topic.type], raw, self.now_ns)

    def close(self):
        """End the server."""
        self.server.close()


def main() -> int:
    """Serve until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--port', type=int, default=PORT)
    chosen = parser.parse_args(remove_ros_args(sys.argv)[1:])
    return spin_node.spin(partial(ViewNode, chosen.port))


if __name__ == '__main__':
    sys.exit(main())
