"""Tells whether a serialised /scenario/reference only repeats the one before, some time later.

The path is sent four times per second, and decoding its poses takes longer than a step of the
controller; comparing its bytes does not. They are CDR, little-endian, one pose after the other
(OMG DDSI-RTPS 2.2, 10; alignments of XCDR1).
"""

import numpy as np

from msgs_yaml.stamp import NS_PER_S

LITTLE_ENDIAN = b'\x00\x01\x00\x00'
STAMP = [('sec', '<i4'), ('nanosec', '<u4')]
FRAME = 'V8'  # its length and three letters with a zero: `map`
POSE = 'V56'
# the first pose begins off the grid of doubles
HEAD = np.dtype(
    [
        ('encapsulation', 'V4'),
        ('stamp', STAMP),
        ('frame', FRAME),
        ('poses', '<u4'),
        ('first_stamp', STAMP),
        ('first_frame', FRAME),
        ('padding', 'V4'),
        ('first_pose', POSE),
    ]
)
REST = np.dtype([('stamp', STAMP), ('frame', FRAME), ('pose', POSE)])


def is_repeat(new: bytes, old: bytes | None) -> bool:
    """Tell whether two messages hold the same poses, with all stamps later by the same time.

    False also for what is not understood: a broken message is none that is known.
    """
    if old is None or len(new) != len(old) or len(new) < HEAD.itemsize:
        return False
    if new[: len(LITTLE_ENDIAN)] != LITTLE_ENDIAN or (len(new) - HEAD.itemsize) % REST.itemsize:
        return False
    (new_head, new_rest), (old_head, old_rest) = _parts(new), _parts(old)
    if new_head['poses'] != len(new_rest) + 1:
        return False
    same = [
        *(new_head[name] == old_head[name] for name in ('encapsulation', 'frame', 'poses')),
        *(new_head[name] == old_head[name] for name in ('first_frame', 'first_pose')),
        *((new_rest[name] == old_rest[name]).all() for name in ('frame', 'pose')),
    ]
    return all(same) and _is_one_shift(_stamps(new_head, new_rest), _stamps(old_head, old_rest))


def size(poses: int) -> int:
    """Return the bytes of a path of so many poses."""
    return HEAD.itemsize + (poses - 1) * REST.itemsize


def _parts(raw):
    head = np.frombuffer(raw, HEAD, count=1)[0]
    return head, np.frombuffer(raw, REST, offset=HEAD.itemsize)


def _stamps(head, rest):
    """Return every stamp of a message [ns]."""
    first = np.array([head['stamp'], head['first_stamp']])
    every = np.concatenate((first, rest['stamp']))
    return every['sec'].astype(np.int64) * NS_PER_S + every['nanosec']


def _is_one_shift(new, old):
    return bool((new - old == new[0] - old[0]).all())
