"""How many messages of a topic were lost, from the publisher's own count of them.

DDS numbers the messages of a publisher from 1 on, and a recording keeps the numbers. What was
lost behind the last message recorded leaves no gap and is not known.


The recorder's health in one line and a few numbers: /diagnostics."""

import json
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from msgs_yaml import contract
from msgs_yaml.types import Health
from node_runtime.input_monitor import OK, STALE, WARN, HeldLevel

LOSS_RECORD = 'losses'  # name of the MCAP metadata record: {topic: a Losses as JSON}


class Losses(NamedTuple):
    """What the numbers tell; None where they tell nothing.

    They tell nothing where the middleware gave none, and where they do not increase: several
    publishers, or one that was started again.
    """

    received: int
    lost: int | None  # between the first and the last message
    gaps: int | None  # places at which something was lost
    longest: int | None  # most lost in one place
    before: int | None  # sent before the first message: nobody listened yet


class LossCounter:
    """Counts the messages of one topic."""

    def __init__(self):
        self._received = self._lost = self._gaps = self._longest = 0
        self._first = self._last = None
        self._telling = True

    def add(self, sequence: int | None) -> None:
        """Count a message; its number is 0 or None where the middleware knows none."""
        self._received += 1
        last, self._last = self._last, sequence
        if last is None:
            self._first = sequence
        if not sequence or (last is not None and sequence <= last):
            self._telling = False
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
        """What is known so far."""
        if not (self._received and self._telling):
            return Losses(self._received, None, None, None, None)
        return Losses(self._received, self._lost, self._gaps, self._longest, self._first - 1)


def loss_record(counted: dict[str, Losses]) -> dict[str, str]:
    """Return the values of the metadata record."""
    return {topic: json.dumps(losses._asdict()) for topic, losses in counted.items()}


RECORDER = 'recorder'
NO_TOPIC = 'none'


class RecordingHealth:
    """Tells the health of a recording; what was lost counts for a while (`HeldLevel`)."""

    def __init__(self, mode: str):
        """In `mode` the contract says which topics nodes publish by themselves."""
        topics = contract.load().topics.values()
        self._expected = [one.name for one in topics if one.rate_hz[mode]]
        self._lost = 0  # when it was told last
        self._held = HeldLevel()

    def health(self, stamp_ns: int, counted: Mapping[str, Losses]) -> Health:
        """Return the health at a stamp; `counted` has what is known of every topic so far."""
        received = sum(one.received for one in counted.values())
        lost = sum(one.lost or 0 for one in counted.values())
        more, self._lost = lost > self._lost, lost
        level = self._held.update(WARN if more else OK if received else STALE, stamp_ns)
        silent = [name for name in self._expected if not counted[name].received]
        values = {'messages': received, 'lost': lost, 'silent': ' '.join(silent) or NO_TOPIC}
        return Health(stamp_ns, RECORDER, level, _MESSAGES[level], values)


_MESSAGES = {
    OK: 'recording',
    WARN: 'messages were lost: the recorder or the network is too slow',
    STALE: 'nothing has been heard yet',
}
