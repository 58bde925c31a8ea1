"""Telling a node many hostile messages in a row."""

import hostile
import nodes
from hypothesis import strategies as st

from node_runtime import ros

BATCH = 20  # of each kind per example


def batches(topic):
    """Return a strategy of several hostile messages, as messages and as bytes."""
    return st.tuples(
        st.lists(hostile.messages(topic), min_size=BATCH, max_size=BATCH),
        st.lists(hostile.raws(topic), min_size=BATCH, max_size=BATCH),
    )


def tell_all(bench, topic, batch, count):
    """Tell a node every message of a batch; bytes that are no message never reach a typed one."""
    messages, raws = batch
    heard = nodes.hearing(bench.node, topic)
    for message in messages:
        heard.callback(ros.serialize(message) if heard.raw else message)
        count(topic)
    for raw in raws:
        if heard.raw:
            heard.callback(raw)
            count(topic)
            continue
        try:
            message = ros.deserialize(topic, raw)
        except ros.DecodeError:
            continue  # the middleware drops it
        heard.callback(message)
        count(topic)
