"""Batches of hostile messages, and sending them to a node."""

import hostile_messages
import node_bench
from hypothesis import strategies as st

from node_runtime import ros

BATCH = 20  # of each kind per example


def batches(topic):
    """Return a strategy of several hostile messages, as messages and as bytes."""
    return st.tuples(
        st.lists(hostile_messages.messages(topic), min_size=BATCH, max_size=BATCH),
        st.lists(hostile_messages.raws(topic), min_size=BATCH, max_size=BATCH),
    )


def send_all(bench, topic, batch, count):
    """Send every message of a batch; typed subscriptions get only bytes that deserialize."""
    messages, raws = batch
    receiver = node_bench.subscription(bench.node, topic)
    for message in messages:
        receiver.callback(ros.serialize(message) if receiver.raw else message)
        count(topic)
    for raw in raws:
        if receiver.raw:
            receiver.callback(raw)
            count(topic)
            continue
        try:
            message = ros.deserialize(topic, raw)
        except ros.DecodeError:
            continue  # the middleware drops it
        receiver.callback(message)
        count(topic)
