"""The log time under which a recorder files a message. No ROS.

In lockstep only /clock defines the time: messages wait for it, as it may arrive late. While time
waits for an answer, nodes send the last message again; how often depends on the wall clock, so it
is filed once. In realtime the log time is the time of arrival.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import partial
from typing import Annotated, Any

from bags.errors import BagError
from bags.storage import cdr
from bags.storage.decoding import stamp_reader
from bags.storage.message_definitions import schema_text, type_hash
from bags.storage.message_loss import LossCounter
from bags.storage.read import LOCKSTEP
from bags.storage.rosbag2_metadata import BagTopic, qos_text
from msgs_yaml.contract import DERIVED_TYPES, Contract, Topic
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
CLOCK = '/clock'  # simulated time, in lockstep
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


class SimulatedTime:
    """The last time on /clock, and the messages that wait for the next one."""

    def __init__(self, listen: Callable[[], None] = lambda: None):
        """`listen` calls `advance` for every message that has arrived on /clock."""
        self.now_ns: int | None = None  # None before the first /clock
        self.filed_ns = 0  # the latest log time of a message
        self._listen = listen
        self._waiting: list[Callable[[], None]] = []
        self._ahead: list[tuple[int, Callable[[], None]]] = []
        self._is_awaited = True

    @property
    def is_awaited(self) -> bool:
        """Whether messages wait for the first /clock."""
        return self.now_ns is None and self._is_awaited

    def advance(self, stamp_ns: int) -> None:
        """Advance to a time on /clock; the time never decreases."""
        self.now_ns = max(stamp_ns, self.now_ns or 0)

    def is_ahead(self, stamp_ns: int) -> bool:
        """Return whether a stamp is ahead of the newest /clock by more than AHEAD_NS."""
        if self.now_ns is None or stamp_ns <= self.now_ns + AHEAD_NS:
            return False
        self._listen()  # messages are taken topic by topic: a later /clock may have arrived
        return stamp_ns > self.now_ns + AHEAD_NS

    def defer(self, file: Callable[[], None]) -> None:
        """File a message at the next /clock."""
        self._waiting.append(file)
        if self.is_awaited and len(self._waiting) > LARGEST_WAIT:
            self._is_awaited = False
            self.release()

    def defer_until(self, stamp_ns: int, file: Callable[[], None]) -> None:
        """File a message when /clock has come near its stamp, or at the end of the recording."""
        self._ahead.append((stamp_ns, file))
        if len(self._ahead) > LARGEST_AHEAD:
            _, file = self._ahead.pop(0)
            file()

    def release(self) -> None:
        """File the waiting messages whose time has come, in the order of arrival."""
        waiting, self._waiting = self._waiting, []
        for file in waiting:
            file()
        if self._ahead and self.now_ns is not None:
            reached = self.now_ns + AHEAD_NS
            ahead, self._ahead = self._ahead, []
            for stamp_ns, file in ahead:
                if stamp_ns <= reached:
                    file()
                else:
                    self._ahead.append((stamp_ns, file))

    def end(self, fell_back: bool = False) -> int:
        """File all waiting messages: /clock has ended. Return how many messages are left out.

        Those are, where /clock `fell_back`, the messages whose stamps had fallen back before it.
        """
        left_out = len(self._waiting) if fell_back else 0
        if fell_back:
            self._waiting = []
        self.release()
        ahead, self._ahead = self._ahead, []
        for _, file in ahead:
            file()
        return left_out


class ClockQueue:
    """Messages of /clock in the order of arrival, also those whose time was read before."""

    def __init__(
        self, arrived: Callable[[], Iterable[tuple[bytes, Any]]], advance: Callable[[int], None]
    ):
        """`arrived` takes messages from the middleware: the bytes come first in each."""
        self._arrived, self._advance = arrived, advance
        self._queue = deque()

    def listen(self) -> None:
        """Read the time on /clock so far; its messages stay in the queue."""
        for message in self._arrived():
            self._queue.append(message)
            with suppress(DecodeError):
                self._advance(stamp_ns_of(message[0]))

    def take(self) -> Iterator[tuple[bytes, Any]]:
        """Yield the messages; `listen` may be called between two of them."""
        self._queue.extend(self._arrived())
        while self._queue:
            yield self._queue.popleft()


def bag_topics(contract: Contract, mode: str) -> list[BagTopic]:
    """Return every topic of the contract as a bag describes it, in the order of the contract."""
    return [bag_topic(topic, mode) for topic in contract.topics.values()]


def bag_topic(topic: Topic, mode: str) -> BagTopic:
    """Return a topic as a bag describes it; FileNotFoundError where its type is not installed."""
    return BagTopic(
        name=topic.name,
        type=topic.type,
        schema=schema_text(topic.type),
        type_hash=type_hash(topic.type),
        qos=_qos(topic.qos[mode]),
    )


def _qos(qos):
    deadline_ns = None if qos.deadline_ms is None else round(qos.deadline_ms * 1e6)
    return qos_text(qos.history, qos.depth, qos.reliability, qos.durability, deadline_ns)


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
        self._ahead_ns: list[int] = []  # stamps of the messages that wait for /clock to reach them
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
            self._file(received_ns, data, source_ns, sequence)
            return
        stamp_ns = self._stamp(data)
        if self._topic.name == CLOCK:
            self._tick(stamp_ns)
        if self._is_repeat(stamp_ns, data):
            self.pass_over()
            return
        self.counter.add(sequence)
        file = partial(self._file_stamped, stamp_ns, data, source_ns, sequence)
        if not self._is_stamped and self._time.now_ns is None:
            self._time.defer_until(0, file)
        elif self._must_wait(stamp_ns):
            self._time.defer(file)
        elif stamp_ns is not None and (self._follows(stamp_ns) or self._time.is_ahead(stamp_ns)):
            self._ahead_ns.append(stamp_ns)
            self._time.defer_until(stamp_ns, partial(self._file_reached, stamp_ns, file))
        else:
            file()

    def pass_over(self) -> None:
        """Leave a message out on purpose: the numbers of those after it have no gap."""
        self._passed_over += 1

    def _is_repeat(self, stamp_ns, data):
        """Return whether a message is the one before, sent again; else it is the newest now."""
        newest_ns, newest = self._newest
        if stamp_ns == newest_ns is not None and (data == newest or self._is_same(data, newest)):
            return True
        self._newest = stamp_ns, data
        return False

    def _is_same(self, *messages):
        """Return whether two messages have the same values: padding is what was in memory."""
        try:
            value, other = (cdr.decode(m, self._topic.schema, self._topic.type) for m in messages)
        except BagError:
            return False
        return value == other

    def _follows(self, stamp_ns):
        """Return whether an earlier message still waits: the order of a topic is kept."""
        return bool(self._ahead_ns) and min(self._ahead_ns) <= stamp_ns

    def _file_reached(self, stamp_ns, file):
        self._ahead_ns.remove(stamp_ns)
        file()

    def _must_wait(self, stamp_ns):
        """Return whether the log time of a message depends on the next /clock."""
        if self._topic.name == CLOCK:
            return False
        falls_back = stamp_ns is not None and stamp_ns < self._last_log_ns
        return self._time.is_awaited or (self._publishes_clock and falls_back)

    def _stamp(self, data):
        """Return the stamp, None without one; a bag has no times before 1970."""
        if not self._is_stamped:
            return None
        try:
            return max(self._stamp_ns(data), 0)
        except DecodeError:
            return None

    def _tick(self, stamp_ns):
        """Advance the time to a stamp of /clock."""
        if stamp_ns is not None:
            self._check(stamp_ns, 0, 'was the plant started again, or are there two?')
            self._time.advance(stamp_ns)
            self._time.release()

    def _file_stamped(self, stamp_ns, data, source_ns, sequence):
        log_ns = self._log_time(stamp_ns)
        if stamp_ns not in (None, log_ns):
            self.misdated += 1
            self.first_misdated = self.first_misdated or (stamp_ns, log_ns)
        self._time.filed_ns = max(self._time.filed_ns, log_ns)
        self._file(log_ns, data, source_ns, sequence)

    def _log_time(self, stamp_ns):
        """Return the log time of a message."""
        if stamp_ns is None:
            present_ns = self._time.now_ns or self._time.filed_ns
            return self._last_log_ns if self._is_stamped else present_ns
        if self._time.is_ahead(stamp_ns):
            return self._time.now_ns
        log_ns = max(stamp_ns, self._last_log_ns) if self._single_publisher else stamp_ns
        # a stamp slightly ahead of /clock must not date the messages that follow it
        now_ns = log_ns if self._time.now_ns is None else self._time.now_ns
        self._last_log_ns = max(self._last_log_ns, min(log_ns, now_ns))
        return log_ns

    def _file(self, log_ns, data, source_ns, sequence):
        self._write(log_ns, source_ns or log_ns, data, sequence or 0)

    def _check(self, log_ns, slack_ns, cause):
        """Raise ClockError when a time falls back by more than the slack."""
        if log_ns < self._last_log_ns - slack_ns:
            before, now = self._last_log_ns / NS_PER_S, log_ns / NS_PER_S
            raise ClockError(
                f'{self._topic.name}: the clock jumped backwards from {before:.9f} s to '
                f'{now:.9f} s: {cause}'
            )
