"""From a recorded message to its value of `msgs_yaml.types`, checked against the contract."""

from typing import Any

from bags.errors import BagError
from bags.storage import cdr
from bags.storage.rosbag2_layout import BagTopic
from msgs_yaml import decode

DECODERS = {
    '/scenario/reference': decode.reference,
    '/scenario/road_edges': decode.road_edges,
    '/scenario/obstacles': decode.obstacles,
    '/vehicle/odometry': decode.odometry,
    '/vehicle/actuators': decode.actuators,
    '/vehicle/imu': decode.imu,
    '/vehicle/wheels': decode.wheels,
    '/controller/command': decode.command,
    '/controller/prediction': decode.prediction,
    '/controller/why': decode.why,
    '/diagnostics': decode.health,
    '/clock': decode.clock,
}
# what a decoder raises: DecodeError, a ValueError, where the contract is broken; the others where
# the definition, which is the bag's own, lacks a field or makes something else of it
INVALID = (BagError, ValueError, AttributeError, TypeError, LookupError, ArithmeticError)


def value(topic: BagTopic, payload: bytes) -> Any:
    """Return the value of a message (CDR with its encapsulation header) of a topic in DECODERS.

    Raises one of INVALID for a message that breaks the contract or does not fit its definition.
    """
    return DECODERS[topic.name](cdr.decode(payload, topic.schema, topic.type))
