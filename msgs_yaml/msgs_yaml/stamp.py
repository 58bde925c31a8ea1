"""ROS time as one whole number of nanoseconds, and back to seconds and nanoseconds."""

NS_PER_S = 1_000_000_000


def to_ns(stamp) -> int:
    """Return the nanoseconds of a builtin_interfaces/Time of any library."""
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)


def split(stamp_ns: int) -> tuple[int, int]:
    """Return (sec, nanosec)."""
    return divmod(int(stamp_ns), NS_PER_S)


def later(stamp_ns: int, t: float) -> int:
    """Return the stamp t seconds later, rounded to 1 ns."""
    return int(stamp_ns) + round(float(t) * NS_PER_S)


def seconds(duration_ns: int) -> float:
    """Return a duration in seconds."""
    return duration_ns / NS_PER_S
