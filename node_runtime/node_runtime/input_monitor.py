"""Age of an input against its limit, as a diagnostic level (REP-107). Times are arguments, in ns.

monitor = InputMonitor('obstacles', limit_s=0.2)
monitor.accept(stamp_ns, now_ns)  # '' or why the stamp is rejected
monitor.update(now_ns)  # OK, WARN beyond half of the limit, ERROR beyond it; call it regularly
monitor.held_level  # the worst level of the last two seconds, for /diagnostics
"""

from msgs_yaml.conversions import NS_PER_S

OK, WARN, ERROR, STALE = range(4)  # diagnostic_msgs/DiagnosticStatus
HOLD_NS = 2 * NS_PER_S
NS_PER_MS = 1e6
NO_REASON = 'none'


class HeldLevel:
    """A level that rises at once and falls two seconds after its cause has ended.

    STALE (nothing received yet) is not held: it ends with the first message.
    """

    def __init__(self):
        self._last_ns: dict[int, int] = {}

    def update(self, level: int, now_ns: int) -> int:
        """Take the present level; return the worst of the last two seconds."""
        # what lies as far ahead is of a run before, from which time went back
        self._last_ns = {k: ns for k, ns in self._last_ns.items() if abs(now_ns - ns) < HOLD_NS}
        if level in (WARN, ERROR):
            self._last_ns[level] = now_ns
        return max((level, *self._last_ns))


class InputMonitor:
    """Age of the newest accepted stamp of one input, and counts of time-outs and rejections."""

    def __init__(self, name: str, limit_s: float):
        self.name = name
        self.limit_ns = round(limit_s * NS_PER_S)
        self.timeouts = 0  # times that the age passed the limit
        self.rejected = 0
        self.reason = NO_REASON  # of the last rejection
        self.held_level = STALE
        self._stamp_ns: int | None = None
        self._worst_ns = 0
        self._is_timed_out = False
        self._worst = (0, 0)  # age when `held_level` was last reached, and that instant
        self._hold = HeldLevel()

    def check(self, stamp_ns: int, now_ns: int) -> str:
        """Return '', or why a stamp is to be rejected: it is further from now than the limit.

        A stamp in the future is rejected like one in the past.
        """
        age_ns = now_ns - stamp_ns
        if abs(age_ns) <= self.limit_ns:
            return ''
        side = 'past' if age_ns > 0 else 'future'
        age_ms, limit_ms = abs(age_ns) / NS_PER_MS, self.limit_ns / NS_PER_MS
        return f'the stamp is {age_ms:.0f} ms in the {side}, limit {limit_ms:g} ms'

    def accept(self, stamp_ns: int, now_ns: int) -> str:
        """Record a stamp and return ''; reject it and return why if `check` objects."""
        reason = self.check(stamp_ns, now_ns)
        if reason:
            return self.reject(reason)
        self.record(stamp_ns)
        return ''

    def record(self, stamp_ns: int) -> None:
        """Record a stamp; one older than the newest changes nothing."""
        if self._stamp_ns is None or stamp_ns > self._stamp_ns:
            self._stamp_ns = stamp_ns

    def reject(self, reason: str) -> str:
        """Count a rejected message; return the reason."""
        self.rejected += 1
        self.reason = reason
        return reason

    def age_ns(self, now_ns: int) -> int | None:
        """Return the age of the newest stamp, at least 0; None before the first."""
        return None if self._stamp_ns is None else max(now_ns - self._stamp_ns, 0)

    def level(self, now_ns: int) -> int:
        """Return the present level; STALE before the first stamp."""
        age_ns = self.age_ns(now_ns)
        if age_ns is None:
            return STALE
        return (age_ns > self.limit_ns) + (2 * age_ns > self.limit_ns)

    def update(self, now_ns: int) -> int:
        """Return the present level; count a time-out, and update `held_level`."""
        level = self.level(now_ns)
        if level != STALE:
            self._worst_ns = max(self._worst_ns, self.age_ns(now_ns))
        self.timeouts += level == ERROR and not self._is_timed_out
        self._is_timed_out = level == ERROR
        self.held_level = self._hold.update(level, now_ns)
        if level == self.held_level != STALE:
            self._worst = (self.age_ns(now_ns), now_ns)
        return level

    def describe(self, now_ns: int) -> str:
        """Return age and limit as text, those of `held_level` where it is over."""
        age_ns, limit = self.age_ns(now_ns), f'limit {self.limit_ns / NS_PER_MS:g} ms'
        if age_ns is None:
            return f'{self.name} was never received'
        if self.held_level == STALE or self.level(now_ns) >= self.held_level:
            return f'{self.name} is {age_ns / NS_PER_MS:.0f} ms old, {limit}'
        age_ns, then_ns = self._worst
        ago_s = (now_ns - then_ns) / NS_PER_S
        return f'{self.name} was {age_ns / NS_PER_MS:.0f} ms old {ago_s:.1f} s ago, {limit}'

    def diagnostics(self, now_ns: int) -> dict[str, float | int | str]:
        """Return the values for /diagnostics; `worst_ms` is the worst age since the last call."""
        age_ns, worst_ns = self.age_ns(now_ns), self._worst_ns
        self._worst_ns = 0
        ages = {}
        if age_ns is not None:
            ages = {'ms': age_ns / NS_PER_MS, 'worst_ms': max(worst_ns, age_ns) / NS_PER_MS}
        values = {
            **ages,
            'limit_ms': self.limit_ns / NS_PER_MS,
            'stale': self.timeouts,
            'refused': self.rejected,
            'reason': self.reason,
        }
        return {f'age.{self.name}_{key}': value for key, value in values.items()}
