"""How old an input is against its limit, as a level of REP-107. Times are arguments, in ns.

watch = Watch('obstacles', limit_s=0.2)
watch.offer(stamp_ns, now_ns)  # '' or why it is turned down
watch.look(now_ns)  # OK, WARN beyond half of the limit, ERROR beyond it; call it regularly
watch.held  # the worst of the last two seconds: for people
"""

from msgs_yaml.stamp import NS_PER_S

OK, WARN, ERROR, STALE = range(4)  # diagnostic_msgs
CALM_NS = 2 * NS_PER_S
NS_PER_MS = 1e6
NEVER = 'none'


class Held:
    """A level that rises at once, and falls when its cause has been away for a while.

    STALE is not held: it says that something has never come, and ends when it comes.
    """

    def __init__(self):
        self._seen_ns: dict[int, int] = {}

    def take(self, level: int, now_ns: int) -> int:
        """Take the level of this instant; return the worst of the last two seconds."""
        if level in (WARN, ERROR):
            self._seen_ns[level] = now_ns
        recent = [one for one, seen_ns in self._seen_ns.items() if now_ns - seen_ns < CALM_NS]
        return max(level, *recent) if recent else level


class Watch:
    """The age of one input: the newest stamp that was taken, and how often it grew too old."""

    def __init__(self, name: str, limit_s: float):
        self.name = name
        self.limit_ns = round(limit_s * NS_PER_S)
        self.stale = 0  # times that the limit was passed
        self.refused = 0  # messages turned down
        self.reason = NEVER  # why the last one was
        self._stamp_ns: int | None = None
        self._worst_ns = 0
        self._was_stale = False
        self.held = STALE
        self._cause_ns = (0, 0)  # of `held`: the last age of that level, and when it was so
        self._levels = Held()

    def offer(self, stamp_ns: int, now_ns: int) -> str:
        """Take a stamp; return '' or why it is refused: further from now than the limit."""
        off_ns = now_ns - stamp_ns
        if abs(off_ns) > self.limit_ns:
            where = 'past' if off_ns > 0 else 'future'
            off_ms, limit_ms = abs(off_ns) / NS_PER_MS, self.limit_ns / NS_PER_MS
            told = f'the stamp is {off_ms:.0f} ms in the {where}, limit {limit_ms:g} ms'
            return self.refuse(told)
        self.take(stamp_ns)
        return ''

    def take(self, stamp_ns: int) -> None:
        """Take a stamp; an older one than before changes nothing."""
        if self._stamp_ns is None or stamp_ns > self._stamp_ns:
            self._stamp_ns = stamp_ns

    def refuse(self, reason: str) -> str:
        """Count a message that is turned down, and return the reason."""
        self.refused += 1
        self.reason = reason
        return reason

    def age_ns(self, now_ns: int) -> int | None:
        """Return the age of the newest stamp, at least 0; None before the first."""
        return None if self._stamp_ns is None else max(now_ns - self._stamp_ns, 0)

    def level(self, now_ns: int) -> int:
        """Return the level of this instant; STALE before the first stamp."""
        age_ns = self.age_ns(now_ns)
        if age_ns is None:
            return STALE
        return (age_ns > self.limit_ns) + (2 * age_ns > self.limit_ns)

    def look(self, now_ns: int) -> int:
        """Return the level of this instant; count, and remember it for `held`."""
        level = self.level(now_ns)
        if level != STALE:
            self._worst_ns = max(self._worst_ns, self.age_ns(now_ns))
        self.stale += level == ERROR and not self._was_stale
        self._was_stale = level == ERROR
        self.held = self._levels.take(level, now_ns)
        if level == self.held != STALE:
            self._cause_ns = (self.age_ns(now_ns), now_ns)
        return level

    def told(self, now_ns: int) -> str:
        """Return age and limit in words."""
        age_ns, limit_ms = self.age_ns(now_ns), self.limit_ns / NS_PER_MS
        if age_ns is None:
            return f'{self.name} has never come'
        return f'{self.name} is {age_ns / NS_PER_MS:.0f} ms old, limit {limit_ms:g} ms'

    def cause(self, now_ns: int) -> str:
        """Return in words what `held` comes from, also when it is over."""
        if self.held == STALE or self.level(now_ns) >= self.held:
            return self.told(now_ns)
        age_ns, seen_ns = self._cause_ns
        ago_s, limit_ms = (now_ns - seen_ns) / NS_PER_S, self.limit_ns / NS_PER_MS
        was = f'{self.name} was {age_ns / NS_PER_MS:.0f} ms old {ago_s:.1f} s ago'
        return f'{was}, limit {limit_ms:g} ms'

    def values(self, now_ns: int) -> dict[str, float | int | str]:
        """Return what a person can act on; the worst age is that since the last call."""
        age_ns, worst_ns = self.age_ns(now_ns), self._worst_ns
        self._worst_ns = 0
        ages = {}
        if age_ns is not None:
            ages = {'ms': age_ns / NS_PER_MS, 'worst_ms': max(worst_ns, age_ns) / NS_PER_MS}
        found = {
            **ages,
            'limit_ms': self.limit_ns / NS_PER_MS,
            'stale': self.stale,
            'refused': self.refused,
            'reason': self.reason,
        }
        return {f'age.{self.name}_{key}': value for key, value in found.items()}
