"""Tells whether a serialised /scenario/reference only repeats the one before, some time later.

The path is sent four times per second, and even reading its bytes takes longer than comparing them.
"""

from msgs_yaml import raw_path


def is_repeat(new: bytes, old: bytes | None) -> bool:
    """Tell whether two messages hold the same poses, with all stamps later by the same time.

    False also for what is not understood: a broken message is none that is known.
    """
    if old is None or len(new) != len(old):
        return False
    ours, theirs = raw_path.parts(new), raw_path.parts(old)
    if ours is None or theirs is None:
        return False
    same = [
        *(ours.head[name] == theirs.head[name] for name in ('frame', 'poses')),
        *(ours.head[name] == theirs.head[name] for name in ('first_frame', 'first_pose')),
        *((ours.rest[name] == theirs.rest[name]).all() for name in ('frame', 'pose')),
    ]
    return all(same) and _is_one_shift(raw_path.stamps_ns(ours), raw_path.stamps_ns(theirs))


def _is_one_shift(new, old):
    return bool((new - old == new[0] - old[0]).all())
