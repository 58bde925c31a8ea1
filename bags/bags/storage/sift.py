"""Leave out the messages of a bag that break the contract, and say how many there were.

So it is with samples of the car whose stamp is of another time (`in_time`).

Nodes turn such a message down and go on, and so do the tools that read a recording: it may come
from a publisher that is none of ours, or from a car that did what the contract holds for
impossible.
"""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from bags.storage import in_range, in_time, stamps
from bags.storage.decoders import DECODERS, INVALID, value
from bags.storage.inbox import LOCKSTEP
from bags.storage.read import STATE, Bag, Invalid, Recording

KEY = 'invalid_messages'  # in JSON


class _Judged(NamedTuple):
    """The value of one message, or why it is invalid."""

    value: Any
    reason: str  # '' when it is valid


def sift(bag: Bag) -> Bag:
    """Return the bag without the messages that break the contract; `Bag.invalid` counts them.

    Samples of the car with a stamp of another time are left out likewise. In lockstep a second
    state of one stamp stays: it is that of a second ring, for which a reader may refuse the bag.
    Topics that the contract does not know stay as they are, and so does a bag that was sifted.
    """
    if bag.sifted:
        return bag
    recordings, decoded, invalid = dict(bag.recordings), {}, {}
    for name, recorded in bag.recordings.items():
        if name not in DECODERS or not recorded.payloads:
            continue
        values, reasons = _judged(recorded)
        if name in in_time.TOPICS:
            keep_twins = name == STATE and bag.run_info.get('mode') == LOCKSTEP
            reasons |= _foreign(recorded, reasons, keep_twins)
        if values is not None:
            decoded[name] = [values[i] for i in range(len(values)) if i not in reasons]
        if reasons:
            recordings[name] = _without(recorded, reasons)
            first = min(reasons)
            invalid[name] = Invalid(len(reasons), f'message {first}: {reasons[first]}')
    return bag._replace(recordings=recordings, decoded=decoded, invalid=invalid, sifted=True)


def counts(bag: Bag) -> dict[str, dict[str, dict[str, Any]]]:
    """Return {'invalid_messages': {topic: {count, first}}} of a sifted bag, {} without any."""
    found = {name: one._asdict() for name, one in bag.invalid.items()}
    return {KEY: found} if found else {}


def lines(found: Mapping[str, Any]) -> Iterator[str]:
    """Yield what `counts` has put into a dictionary, a line per topic."""
    for name, one in found.get(KEY, {}).items():
        yield f'{one["count"]} invalid messages of {name} were left out; {one["first"]}'


def _judged(recorded) -> tuple[list[Any] | None, dict[int, str]]:
    """Return the values of all messages, None where not all were decoded, and what is wrong."""
    topic, payloads = recorded.topic, recorded.payloads
    in_order = in_range.rows(topic, payloads)
    known, reasons = {}, {}
    for i in np.flatnonzero(~in_order).tolist():
        payload = payloads[i]
        if payload not in known:
            known[payload] = _value(topic, payload)
        if known[payload].reason:
            reasons[i] = known[payload].reason
    if in_order.any():
        return None, reasons
    return [known[payload].value for payload in payloads], reasons


def _foreign(recorded, reasons, keep_twins):
    """Return what is wrong with samples of another time among those that obey the contract."""
    rows = np.setdiff1d(np.arange(len(recorded.payloads)), list(reasons))
    if not rows.size:
        return {}
    stamp_ns = stamps.of(recorded.topic.name, [recorded.payloads[row] for row in rows])
    found = in_time.foreign(stamp_ns, recorded.log_ns[rows], keep_twins)
    return {int(rows[k]): reason for k, reason in found}


def _value(topic, payload):
    try:
        return _Judged(value(topic, payload), '')
    except INVALID as error:
        return _Judged(None, str(error).removeprefix(f'{topic.name}: ') or type(error).__name__)


def _without(recorded: Recording, rows) -> Recording:
    kept = np.setdiff1d(np.arange(len(recorded.payloads)), list(rows))
    return Recording(
        recorded.topic,
        recorded.log_ns[kept],
        recorded.publish_ns[kept],
        recorded.sequence[kept],
        [recorded.payloads[i] for i in kept],
    )
