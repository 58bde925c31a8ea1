"""When messages were sent and when they were answered, from the times that a bag keeps.

The publisher's time is wall clock in every mode; so latency means something in lockstep too: how
long a state waited for its command, transport and computing together.
"""

from typing import NamedTuple

import numpy as np

from bags.storage import read, stamps
from bags.verdict import answers
from msgs_yaml import contract
from msgs_yaml.stamp import NS_PER_S
from msgs_yaml.types import Why

STATE = '/vehicle/odometry'
COMMAND = '/controller/command'
CLOCK = '/clock'
WHY = '/controller/why'


class Latency(NamedTuple):
    """One row per command that answers a recorded state, n of them."""

    stamp_ns: np.ndarray  # (n,) int64, of the state and of the command
    latency_s: np.ndarray  # (n,) from sending the state to sending the command


def stamps_ns(recorded: read.Recording) -> np.ndarray:
    """Header stamps (n,) int64 of a topic whose messages begin with one; BagError without."""
    return stamps.of(recorded.topic.name, recorded.payloads)


def latency(bag: read.Bag) -> Latency:
    """Join every answer with the state of equal stamp; BagError when either topic is empty.

    A state that was sent again counts from the last time it was sent before the command.
    """
    states, commands = read.recording(bag, STATE), read.recording(bag, COMMAND)
    sent_ns = {}
    for stamp, publish in zip(stamps_ns(states).tolist(), states.publish_ns.tolist()):
        sent_ns.setdefault(stamp, []).append(publish)
    rows = []
    of_ns = stamps_ns(commands)
    kept = answers.are(of_ns, whys(bag))
    for stamp, publish in zip(of_ns[kept].tolist(), commands.publish_ns[kept].tolist()):
        before = [sent for sent in sent_ns.get(stamp, ()) if sent <= publish]
        if before:
            rows.append((stamp, publish - max(before)))
    joined = np.array(rows, dtype=np.int64).reshape(-1, 2)
    return Latency(joined[:, 0], joined[:, 1] / NS_PER_S)


def period_ns(mode: str) -> int:
    """Period of the controller in a mode, from the contract."""
    return round(NS_PER_S / contract.load().topics[COMMAND].rate_hz[mode])


def has(bag: read.Bag, *topics: str) -> bool:
    """Tell whether there is a message of each of the topics."""
    return all(name in bag.recordings and bag.recordings[name].payloads for name in topics)


def mode(bag: read.Bag) -> str:
    """Return lockstep or realtime: only lockstep has simulated time."""
    return 'lockstep' if has(bag, CLOCK) else 'realtime'


def whys(bag: read.Bag) -> list[Why]:
    """Return what the controller said of its answers; nothing where that was not recorded."""
    return list(read.values(bag, WHY)) if has(bag, WHY) else []
