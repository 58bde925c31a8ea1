"""The log time under which a recorder files a message, and how many were lost. No ROS.

In lockstep only /clock defines the time: messages wait for it, as it may arrive late. While time
waits for an answer, nodes send the last message again; how often depends on the wall clock, so it
is filed once. In realtime the log time is the time of arrival.

DDS numbers the messages of a publisher from 1 on, and a recording keeps the numbers. Messages lost
after the last recorded one leave no gap and cannot be counted.
"""

import heapq
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import partial
from itertools import count
from typing import Annotated, NamedTuple

from bags.errors import BagError
from bags.storage import cdr
from bags.storage.cdr import schema_text, type_hash
from bags.storage.columns import stamp_reader
from bags.storage.read import LOCKSTEP
from bags.storage.rosbag2_metadata import BagTopic, qos_text
from msgs_yaml.contract import DERIVED_TYPES, Topic
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.decode import DecodeError, stamp_ns_of
from node_runtime.parameters import Range, Struct

# how far a stamp may be ahead of /clock: the plant sends the states of 50 ms before /clock
AHEAD_NS = 1_000_000_000
# messages that wait for the first /clock; so many are kept where there is none
LARGEST_WAIT = 500
# messages with a stamp far ahead of /clock. DDS repeats a lost packet after seconds: /clock may
# arrive after later messages, at 3,300 messages per second of simulated time
LARGEST_AHEAD = 30_000
LOSS_RECORD = 'losses'  # name of the MCAP metadata record: {topic: a Losses as JSON}
CLOCK = '/clock'  # simulated time, in lockstep
NEXT = -1  # before every time
# by how much times of arrival may decrease: DDS may deliver a repeated packet late
SLACK_NS = 100_000_000


class RecorderParams(Struct):
    """Parameters of the recorder, see config/recorder.yaml; checked before a run starts."""

    out: str
    run_info: str
    chunk_s: Annotated[float, Range(0.01, 0.5, 's')]
    poll_s: Annotated[float, Range(0.001, 0.1, 's')]
    split_mb: Annotated[float, Range(0.0, 1e6, 'MB')]
    split_s: Annotated[float, Range(0.0, 1e6, 's')]


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
        self._received = self._lost = self._gaps = self._longest = self._before = self._last = 0
        self._increasing = True

    def add(self, sequence: int | None) -> None:
        """Count a message; its number is 0 or None where the middleware gives none."""
        missing = (sequence or 0) - self._last - 1
        self._increasing &= missing >= 0
        if not self._received:
            self._before = missing
        elif missing > 0:
            self._lost += missing
            self._gaps += 1
            self._longest = max(self._longest, missing)
        self._received += 1
        self._last = sequence or 0

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
        return Losses(self._received, self._lost, self._gaps, self._longest, self._before)


class SimulatedTime:
    """The last time on /clock, and the messages that wait for a later one."""

    def __init__(self, arrived: Callable[[], Iterable[tuple]] = tuple):
        """`arrived` takes messages of /clock from the middleware: the bytes come first in each."""
        self.now_ns: int | None = None  # None before the first /clock
        self.filed_ns = 0  # the latest log time of a message
        self.is_awaited = True  # whether messages wait for the first /clock
        self._arrived, self._heard = arrived, deque()
        # (due, number, filing, message): filed when /clock reaches `due`, NEXT at any /clock
        self._waiting: list[tuple[int, int, Filing, tuple]] = []
        self._number = count()

    def advance(self, stamp_ns: int) -> None:
        """Advance to a time on /clock, which never decreases."""
        self.now_ns, self.is_awaited = max(stamp_ns, self.now_ns or 0), False

    def take(self) -> Iterator[tuple]:
        """Yield the messages of /clock, in the order of arrival, also those read before."""
        self._heard.extend(self._arrived())
        while self._heard:
            yield self._heard.popleft()

    def is_ahead(self, stamp_ns: int) -> bool:
        """Return whether a stamp is ahead of the newest /clock by more than AHEAD_NS."""
        if self.now_ns is None or stamp_ns <= self.now_ns + AHEAD_NS:
            return False
        # messages are taken topic by topic: a later /clock may have arrived
        for message in self._arrived():
            self._heard.append(message)
            with suppress(DecodeError):
                self.advance(stamp_ns_of(message[0]))
        return stamp_ns > self.now_ns + AHEAD_NS

    def defer(self, due_ns: int, filing: 'Filing', message: tuple) -> None:
        """File a message when /clock reaches `due_ns`, or at the end of the recording."""
        heapq.heappush(self._waiting, (due_ns, next(self._number), filing, message))
        if self.is_awaited and len(self._waiting) > LARGEST_WAIT:
            self.is_awaited = False
            self.release()
        while len(self._waiting) > LARGEST_AHEAD:
            self._file_next()

    def release(self) -> None:
        """File the messages whose time has come."""
        until_ns = NEXT if self.now_ns is None else self.now_ns
        while self._waiting and self._waiting[0][0] <= until_ns:
            self._file_next()

    def _file_next(self):
        _, _, filing, message = heapq.heappop(self._waiting)
        filing.file_now(*message)

    def end(self, fell_back: bool = False) -> int:
        """File all waiting messages: /clock has ended. Return how many messages are left out.

        Those are, where /clock `fell_back`, the messages whose stamps had fallen back before it.
        """
        left_out = 0
        while fell_back and self._waiting and self._waiting[0][0] == NEXT:
            heapq.heappop(self._waiting)
            left_out += 1
        while self._waiting:
            self._file_next()
        return left_out


def bag_topic(topic: Topic, mode: str) -> BagTopic:
    """Return a topic as a bag describes it; FileNotFoundError where its type is not installed."""
    kind = topic.type
    return BagTopic(topic.name, kind, schema_text(kind), type_hash(kind), qos_text(topic.qos[mode]))


class ClockError(BagError):
    """A clock was set back during a recording."""


class Filing:
    """Files the messages of one topic into a bag under the right log time."""

    def __init__(
        self,
        topic: BagTopic,
        mode: str,
        write: Callable[[int, int, bytes, int], None],
        single_publisher: bool = True,
        time: SimulatedTime | None = None,
        publishes_clock: bool = False,
    ):
        """`single_publisher`: the topic has one publisher, so its time never falls back.

        `time` is shared by all topics of a recording in lockstep; only /clock advances it.
        `publishes_clock`: the publisher of /clock publishes this topic, too.
        """
        self.counter = LossCounter()
        self.misdated = 0  # messages filed under another time than their stamp
        self.first_misdated: tuple[int, int] | None = None  # ns: stamp, and where it is filed
        self._topic, self._write = topic, write
        self._single_publisher, self._publishes_clock = single_publisher, publishes_clock
        # of those the stamp is missing, or that of another clock: filed under the present time
        self._is_stamped = topic.type not in DERIVED_TYPES
        self._stamp_ns = stamp_reader(topic.type)
        self._time = (time or SimulatedTime()) if mode == LOCKSTEP else None
        self._last_log_ns = 0  # in lockstep never beyond /clock
        self._passed_over = 0  # messages
        self._ahead_ns: list[int] = []  # heap of the stamps that wait for /clock to reach them
        self._newest: tuple[int | None, bytes] = (None, b'')  # stamp and bytes

    def file(self, data: bytes, source_ns: int, received_ns: int, sequence: int | None):
        """File one message under its stamp (lockstep) or its time of arrival (realtime).

        `source_ns` and `sequence` are the publisher's, 0 and None where the middleware gives none.
        In lockstep a stamp that /clock never reaches, or one that falls back, is that of another
        program or of a restarted node: the message is filed under the last time of /clock, or under
        the last time of its topic. A message far ahead waits for /clock, which may arrive later; so
        do all before the first /clock, and one of the plant that falls back: if /clock falls back
        as well, that message is never filed. Nor is one that is sent again, byte for byte but for
        what a serialiser leaves between its fields; the numbers of later ones do not count it.

        Raises ClockError, and files nothing, when /clock (lockstep) or the arrival falls back.
        """
        sequence = sequence and max(sequence - self._passed_over, 0)
        if self._time is None:
            if self._single_publisher:
                self._check(received_ns, SLACK_NS, 'the clock of the machine was set back')
            self._last_log_ns = received_ns
            self.counter.add(sequence)
            self._write(received_ns, source_ns or received_ns, data, sequence or 0)
            return
        time, stamp_ns = self._time, None
        if self._is_stamped:
            with suppress(DecodeError):
                stamp_ns = max(self._stamp_ns(data), 0)  # a bag has no times before 1970
        is_clock = self._topic.name == CLOCK
        if is_clock and stamp_ns is not None:
            self._check(stamp_ns, 0, 'was the plant started again, or are there two?')
            time.advance(stamp_ns)
            time.release()
        if self._is_repeat(stamp_ns, data):
            self.pass_over()
            return
        self.counter.add(sequence)
        message = stamp_ns, data, source_ns, sequence
        falls_back = stamp_ns is not None and stamp_ns < self._last_log_ns
        if not self._is_stamped and time.now_ns is None:
            time.defer(0, self, message)
        elif not is_clock and (time.is_awaited or (self._publishes_clock and falls_back)):
            time.defer(NEXT, self, message)
        elif stamp_ns is not None and (
            # the order of a topic is kept
            (self._ahead_ns and self._ahead_ns[0] <= stamp_ns) or time.is_ahead(stamp_ns)
        ):
            heapq.heappush(self._ahead_ns, stamp_ns)
            time.defer(stamp_ns - AHEAD_NS, self, message)
        else:
            self.file_now(*message)

    def pass_over(self) -> None:
        """Leave a message out on purpose: the numbers of those after it have no gap."""
        self._passed_over += 1

    def _is_repeat(self, stamp_ns, data):
        """Return whether a message is the one before, sent again; else it is the newest now."""
        newest_ns, newest = self._newest
        self._newest = stamp_ns, data
        if stamp_ns is None or stamp_ns != newest_ns:
            return False
        try:
            # padding is what was in memory
            read = partial(cdr.decode, text=self._topic.schema, type_name=self._topic.type)
            return data == newest or read(data) == read(newest)
        except BagError:
            return False

    def file_now(self, stamp_ns: int | None, data: bytes, source_ns: int, sequence: int | None):
        """File a message that waits for nothing any more; its stamp is None where it has none."""
        time = self._time
        if self._ahead_ns and self._ahead_ns[0] == stamp_ns:
            heapq.heappop(self._ahead_ns)
        if stamp_ns is None:
            present_ns = time.now_ns or time.filed_ns
            log_ns = self._last_log_ns if self._is_stamped else present_ns
        elif time.is_ahead(stamp_ns):
            log_ns = time.now_ns
        else:
            log_ns = max(stamp_ns, self._last_log_ns) if self._single_publisher else stamp_ns
            # a stamp slightly ahead of /clock must not date the messages that follow it
            now_ns = log_ns if time.now_ns is None else time.now_ns
            self._last_log_ns = max(self._last_log_ns, min(log_ns, now_ns))
        if stamp_ns not in (None, log_ns):
            self.misdated += 1
            self.first_misdated = self.first_misdated or (stamp_ns, log_ns)
        time.filed_ns = max(time.filed_ns, log_ns)
        self._write(log_ns, source_ns or log_ns, data, sequence or 0)

    def _check(self, log_ns, slack_ns, cause):
        """Raise ClockError when a time falls back by more than the slack."""
        if log_ns < self._last_log_ns - slack_ns:
            before, now = self._last_log_ns / NS_PER_S, log_ns / NS_PER_S
            raise ClockError(
                f'{self._topic.name}: the clock jumped backwards from {before:.9f} s to '
                f'{now:.9f} s: {cause}'
            )
