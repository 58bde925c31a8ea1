"""ROS node that turns the objects of other programs into obstacles and predictions."""

import sys
import time
from importlib import import_module

from msgs_yaml import encode, share
from node_runtime import ros, spin_node
from node_runtime.log_filters import RejectionLog
from node_runtime.managed_node import ManagedNode
from node_runtime.parameters import ParameterError
from scenario_publisher.perceived_objects import (
    TYPES,
    ConverterParams,
    from_autoware,
    from_derived,
)


class ConverterNode(ManagedNode):
    """Publishes an answer to every message, under its stamp."""

    def __init__(self):
        super().__init__('converter')
        defaults = share.path('scenario_publisher', 'config', 'converter_node.yaml')
        self.params = ros.declare(self, ConverterParams, defaults)

    def configure(self):
        """Take the type of the objects, and join the graph."""
        package, name = self.params.type.split('/')
        try:
            kind = getattr(import_module(f'{package}.msg'), name)
        except ModuleNotFoundError:
            apt = f'ros-jazzy-{package.replace("_", "-")}'
            raise ParameterError(f'type: {package} is not installed; apt install {apt}') from None
        self.convert = from_autoware if self.params.type == TYPES[0] else from_derived
        self.refusals = RejectionLog(f'object of {self.params.topic}')
        self.predictions_pub = ros.publisher(self, '/scenario/predictions')
        self.obstacles_pub = ros.publisher(self, '/scenario/obstacles')
        self.create_subscription(kind, self.params.topic, self.on_objects, 1)

    def on_objects(self, message):
        """Publish what the objects are in the contract; log those that are refused.

        Nothing if all are, as obstacles without any would say that the road is free.
        """
        if message.header.frame_id != 'map':
            text = f'frame_id is {message.header.frame_id!r}; allowed map'
            self.get_logger().error(text, throttle_duration_sec=1.0)
        elif self.is_active:
            obstacles, predictions = self.convert(message, self.params.overhang_m)
            for kind, reason in obstacles.refused:
                line = self.refusals.line(kind, reason, time.monotonic_ns())
                if line:
                    self.get_logger().warning(line)
            if obstacles.items or not obstacles.refused:
                self.predictions_pub.publish(encode.predictions(predictions))
                self.obstacles_pub.publish(encode.obstacles(obstacles))


def main():
    """Run the node."""
    about = 'Turn the objects of Autoware, or derived_object_msgs, into obstacles and predictions.'
    return spin_node.run(ConverterNode, about, '--ros-args -p mode:=realtime -p topic:=/objects')


if __name__ == '__main__':
    sys.exit(main())
