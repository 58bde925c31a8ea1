"""What time it is in a recording in lockstep: /clock says so, the stamps of other topics do not."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import Any

from msgs_yaml.decode import DecodeError, stamp_ns_of

# how far a stamp may be ahead of /clock: the plant sends the states of 50 ms, then the clock
AHEAD_NS = 1_000_000_000
# messages that wait for the first /clock; a recording without a clock keeps no more in memory
LARGEST_WAIT = 500
# messages with a stamp far ahead of /clock. What is lost on its way DDS sends again after seconds:
# /clock may come later than what follows it, at 3,300 messages per second of simulated time
LARGEST_AHEAD = 30_000


class SimulatedTime:
    """The last time on /clock, and the messages whose time is known once it is heard again."""

    def __init__(self, listen: Callable[[], None] = lambda: None):
        """`listen` calls `hear` for what has arrived on /clock by now."""
        self.now_ns: int | None = None  # None: no /clock was heard
        self._listen = listen
        self._waiting: list[Callable[[], None]] = []
        self._ahead: list[tuple[int, Callable[[], None]]] = []
        self._is_awaited = True

    @property
    def is_awaited(self) -> bool:
        """Whether messages wait for the first /clock."""
        return self.now_ns is None and self._is_awaited

    def hear(self, stamp_ns: int) -> None:
        """Note a time on /clock; it never goes back."""
        self.now_ns = max(stamp_ns, self.now_ns or 0)

    def is_ahead(self, stamp_ns: int) -> bool:
        """Tell whether a stamp is beyond the newest /clock by more than AHEAD_NS."""
        if self.now_ns is None or stamp_ns <= self.now_ns + AHEAD_NS:
            return False
        self._listen()  # messages of a topic are taken together: the clock may be further by now
        return stamp_ns > self.now_ns + AHEAD_NS

    def wait(self, file: Callable[[], None]) -> None:
        """File a message when /clock is heard the next time."""
        self._waiting.append(file)
        if self.is_awaited and len(self._waiting) > LARGEST_WAIT:
            self._is_awaited = False
            self.release()

    def wait_until(self, stamp_ns: int, file: Callable[[], None]) -> None:
        """File a message when /clock has come near its stamp, or at the end of the recording."""
        self._ahead.append((stamp_ns, file))
        if len(self._ahead) > LARGEST_AHEAD:
            _, file = self._ahead.pop(0)
            file()

    def release(self) -> None:
        """File what waits and whose time has come, in the order in which it came."""
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
        """File what waits: no more is heard of /clock. Return how many messages are left out.

        Those are, where /clock `fell_back`, the ones that had fallen back before it.
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
    """Messages of /clock in the order of their arrival, also those that were heard before."""

    def __init__(
        self, arrived: Callable[[], Iterable[tuple[bytes, Any]]], hear: Callable[[int], None]
    ):
        """`arrived` takes messages from the middleware: the bytes come first in each."""
        self._arrived, self._hear = arrived, hear
        self._queue = deque()

    def listen(self) -> None:
        """Hear the time on /clock by now; its messages stay in the queue."""
        for message in self._arrived():
            self._queue.append(message)
            with suppress(DecodeError):
                self._hear(stamp_ns_of(message[0]))

    def take(self) -> Iterator[tuple[bytes, Any]]:
        """Yield the messages; whoever files one may listen before the next."""
        self._queue.extend(self._arrived())
        while self._queue:
            yield self._queue.popleft()
