"""The ROS time of a raw message, without decoding it."""

from collections.abc import Callable

from msgs_yaml.decode import stamp_ns_of

MARKERS = 'visualization_msgs/msg/MarkerArray'
HEADER = 4  # bytes of encapsulation
COUNT = 4  # bytes that say how many markers there are
STAMP = 8  # bytes


def reader(type_name: str) -> Callable[[bytes], int]:
    """Return stamp_ns(data) for a type: a MarkerArray's first marker has the stamp.

    Every other type of the contract begins with its stamp. The function raises
    `msgs_yaml.decode.DecodeError` for a message without one, such as no markers at all.
    """
    return _of_first_marker if type_name == MARKERS else stamp_ns_of


def _of_first_marker(data):
    begin = HEADER + COUNT
    return stamp_ns_of(data[:HEADER] + data[begin : begin + STAMP])
