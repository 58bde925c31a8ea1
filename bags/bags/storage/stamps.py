"""The ROS time of a raw message, without decoding it."""

from collections.abc import Callable, Sequence

import numpy as np

from bags.errors import BagError
from msgs_yaml.decode import DecodeError, stamp_ns_of

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


def of(topic: str, payloads: Sequence[bytes]) -> np.ndarray:
    """Return the stamps (n,) int64 [ns] of messages that begin with a header.

    Raises BagError for one without, which names the topic and the number of the message.
    """
    stamps_ns = np.empty(len(payloads), dtype=np.int64)
    for i, data in enumerate(payloads):
        try:
            stamps_ns[i] = stamp_ns_of(data)
        except DecodeError as error:
            raise BagError(f'message {i} of {topic}: {error}') from error
    return stamps_ns


def _of_first_marker(data):
    begin = HEADER + COUNT
    return stamp_ns_of(data[:HEADER] + data[begin : begin + STAMP])
