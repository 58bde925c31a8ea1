"""Lost messages per topic, from DDS sequence numbers, and the health of a recording.

DDS numbers the messages of a publisher from 1 on, and a recording keeps the numbers. Messages lost
after the last recorded one leave no gap and cannot be counted.
"""

import json
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from msgs_yaml import contract
from msgs_yaml.types import Health
from node_runtime.input_monitor import OK, STALE, WARN, HeldLevel

RECORDER = 'recorder'
NO_TOPIC = 'none'
LOSS_RECORD = 'losses'  # name of the MCAP metadata record: {topic: a Losses as JSON}
_MESSAGES = {
    OK: 'recording',
    WARN: 'messages were lost: the recorder or the network is too slow',
    STALE: 'no message has arrived yet',
}


class Losses(NamedTuple):
    """Counts of one topic; None where the sequence numbers are of no use.

    They are of no use where the middleware gives none, and where they do not increase: several
    publishers, or one that was restarted.
    """

    received: int
    lost: int | None  # between the first and the last message
    gaps: int | None  # gaps in the numbers
    longest: int | None  # most messages lost in one gap
    before: int | None  # sent before the recorder subscribed


class LossCounter:
    """Counts the messages of one topic."""

    def __init__(self):
        self._received = self._lost = self._gaps = self._longest = 0
        self._first = self._last = None
        self._increasing = True

    def add(self, sequence: int | None) -> None:
        """Count a message; its number is 0 or None where the middleware gives none."""
        self._received += 1
        last, self._last = self._last, sequence
        if last is None:
            self._first = sequence
        if not sequence or (last is not None and sequence <= last):
            self._increasing = False
        elif last is not None and sequence > last + 1:
            missing = sequence - last - 1
            self._lost += missing
            self._gaps += 1
            self._longest = max(self._longest, missing)

    def add_all(self, sequence: Iterable[int]) -> 'LossCounter':
        """Count many messages; return this counter."""
        for number in sequence:
            self.add(number)
        return self

    @property
    def losses(self) -> Losses:
        """The counts so far."""
        if not (self._received and self._increasing):
            return Losses(self._received, None, None, None, None)
        return Losses(self._received, self._lost, self._gaps, self._longest, self._first - 1)


def loss_record(counted: dict[str, Losses]) -> dict[str, str]:
    """Return the values of the metadata record."""
    return {topic: json.dumps(losses._asdict()) for topic, losses in counted.items()}


class RecordingHealth:
    """Computes the health of a recording; a loss is held for a while (`HeldLevel`)."""

    def __init__(self, mode: str):
        """Take from the contract which topics nodes publish without request in `mode`."""
        topics = contract.load().topics.values()
        self._expected = [topic.name for topic in topics if topic.rate_hz[mode]]
        self._lost = 0  # at the last report
        self._held = HeldLevel()

    def health(self, stamp_ns: int, counted: Mapping[str, Losses]) -> Health:
        """Return the health at a stamp; `counted` are the losses of every topic so far."""
        received = sum(losses.received for losses in counted.values())
        lost = sum(losses.lost or 0 for losses in counted.values())
        more, self._lost = lost > self._lost, lost
        level = self._held.update(WARN if more else OK if received else STALE, stamp_ns)
        silent = [name for name in self._expected if not counted[name].received]
        values = {'messages': received, 'lost': lost, 'silent': ' '.join(silent) or NO_TOPIC}
        return Health(stamp_ns, RECORDER, level, _MESSAGES[level], values)
