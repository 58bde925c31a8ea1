"""Whether a path only repeats the one before, told from its bytes."""

import numpy as np
import pytest

from msgs_yaml import encode, raw_path
from msgs_yaml.repeats import is_repeat
from msgs_yaml.types import Reference
from node_runtime import ros

S = 1_000_000_000
PATH = Reference(
    5 * S + 3,
    np.array([0.0, 1.0, 2.0, 4.0]),
    np.array([0.0, 0.0, 0.1, 0.2]),
    np.array([0.0, 0.1, 0.1, 0.0]),
    np.array([0.0, 0.05, 0.1, 0.9]),
)


def raw(**changed):
    return ros.serialized(encode.reference(PATH._replace(**changed)))


@pytest.mark.parametrize('stamp_ns', [PATH.stamp_ns, PATH.stamp_ns - S, 1_795_000_000_987_654_321])
def test_the_same_poses_at_another_time_are_a_repetition(stamp_ns):
    assert is_repeat(raw(stamp_ns=stamp_ns), raw())


def test_two_poses_are_enough():
    short = {name: getattr(PATH, name)[:2] for name in ('X', 'Y', 'psi', 't')}
    assert is_repeat(raw(**short, stamp_ns=9 * S), raw(**short))
    assert not is_repeat(raw(**short), raw())


@pytest.mark.parametrize('index', range(4))
@pytest.mark.parametrize('name', ['X', 'Y', 'psi'])
def test_a_pose_that_moved_by_the_least_bit_is_another_path(name, index):
    column = getattr(PATH, name).copy()
    column[index] = np.nextafter(column[index] + 0.1, 9.0)
    assert not is_repeat(raw(**{name: column}), raw())


@pytest.mark.parametrize('index', [1, 3])
def test_another_speed_is_another_path(index):
    t = PATH.t.copy()
    t[index] += 1e-9
    assert not is_repeat(raw(t=t), raw())


@pytest.mark.parametrize('byte', [0, 12, 16, 20, 32, 36, 112, 116])
def test_another_layout_count_or_frame_is_not_understood(byte):
    broken = bytearray(raw())
    broken[byte] ^= 1
    assert not is_repeat(bytes(broken), raw())


def test_what_is_cut_or_the_first_is_none():
    assert not is_repeat(raw(), None)
    for size in (0, 4, 50, len(raw()) - 72, len(raw()) - 1):
        assert not is_repeat(raw()[:size], raw()[:size])


@pytest.mark.parametrize('poses', [2, 51, 5000])
def test_the_size_of_a_path_is_told_without_making_one(poses):
    X = np.arange(float(poses))
    made = encode.reference(Reference(1, X, 0 * X, 0 * X, X))
    assert len(ros.serialized(made)) == raw_path.size(poses)
