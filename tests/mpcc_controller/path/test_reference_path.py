"""The path as arcs: which paths are rejected, the foot of a point, the arcs of the stages."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.path import arc, reference_path
from mpcc_controller.path.reference_path import PathError

quick = settings(max_examples=100)
R = 25.0


def circle(world, turn, step=1.0, length=120.0, v=15.0):
    """Return a circular path to the left (turn 1) or right, from the origin along x."""
    s = np.arange(0, length, step)
    X, Y = R * np.sin(s / R), turn * R * (1 - np.cos(s / R))
    ds = 2 * R * np.sin(step / R / 2)
    path = world.path(X, Y, v)
    return path._replace(psi=turn * s / R, t=path.t * step / ds)


def s_bend(world):
    X = np.arange(0.0, 150.0, 0.5)
    return reference_path.build(world.path(X, 3 * np.sin(X / 20), 20.0))


@pytest.mark.parametrize('turn', [1, -1])
def test_arcs_follow_a_circle_exactly(world, turn):
    path = reference_path.build(circle(world, turn, step=3.0))
    theta = np.linspace(0, 100, 37)
    arcs, v = reference_path.arcs_at(path, theta)
    assert pytest.approx(R * np.sin(theta / R), abs=1e-5) == arcs.X
    assert pytest.approx(turn * R * (1 - np.cos(theta / R)), abs=1e-5) == arcs.Y
    assert arcs.psi == pytest.approx(turn * theta / R, abs=1e-6)
    assert arcs.kappa == pytest.approx(turn / R, abs=1e-6)
    assert v == pytest.approx(15.0)


@pytest.mark.parametrize('turn', [1, -1])
def test_the_arc_of_a_stage_is_the_path_around_it(world, turn):
    path = reference_path.build(circle(world, turn))
    arcs, _ = reference_path.arcs_at(path, np.array([40.0]))
    pose = arc.pose_at(arcs, 42.5)
    assert float(pose.X[0]) == pytest.approx(R * np.sin(42.5 / R), abs=1e-5)
    assert float(pose.psi[0]) == pytest.approx(turn * 42.5 / R, abs=1e-6)


def test_speed_is_distance_over_time_between_the_stamps(world):
    X = np.array([0.0, 10.0, 20.0, 40.0])
    path = world.path(X, 0 * X, 10.0)._replace(t=np.array([0.0, 1.0, 3.0, 4.0]))
    _, v = reference_path.arcs_at(
        reference_path.build(path), np.array([-5.0, 5.0, 15.0, 30.0, 99.0])
    )
    assert v == pytest.approx([10, 10, 5, 20, 20])


def test_a_path_without_stamps_has_the_speed_of_the_parameter_and_else_names_it(world):
    timed = circle(world, 1)
    still = timed._replace(t=0.0 * timed.t)
    _, v = reference_path.arcs_at(reference_path.build(still, 12.5), np.array([-5.0, 40.0, 999.0]))
    assert v.tolist() == [12.5, 12.5, 12.5]
    with_both = reference_path.build(timed, 12.5)
    assert reference_path.is_equal(with_both, reference_path.build(timed))
    with pytest.raises(PathError, match=r'surroundings\.path_speed_mps'):
        reference_path.build(still)


def test_beyond_its_ends_the_path_continues_straight(world):
    path = reference_path.build(circle(world, 1))
    arcs, _ = reference_path.arcs_at(path, np.array([-10.0, path.length + 10.0]))
    end = path.length / R
    assert (arcs.X[0], arcs.Y[0]) == pytest.approx((-10.0, 0.0), abs=1e-6)
    assert arcs.X[1] == pytest.approx(R * np.sin(end) + 10 * np.cos(end), abs=1e-5)
    assert list(arcs.kappa) == [0, 0]


@quick
@given(st.floats(2, 140), st.floats(-4, 4))
def test_the_foot_of_a_point_beside_the_path_is_its_arc_length(world, theta, left):
    path = s_bend(world)
    here, _ = reference_path.arcs_at(path, theta)
    X, Y = here.X - left * np.sin(here.psi), here.Y + left * np.cos(here.psi)
    foot = reference_path.project(path, X, Y, theta + 3.0, 10.0)
    assert foot == pytest.approx(theta, abs=1e-6)
    assert reference_path.project(path, X, Y, None, 10.0) == pytest.approx(theta, abs=1e-6)


def test_the_foot_may_lie_beyond_both_ends(world):
    path = reference_path.build(world.straight().reference)
    assert reference_path.project(path, -7.0, 1.0, None, 10.0) == pytest.approx(-7.0)
    assert reference_path.project(path, 320.0, 1.0, 295.0, 10.0) == pytest.approx(320.0)


def test_the_foot_does_not_jump_to_the_other_leg_of_a_hairpin(world):
    """A hairpin: both legs are 6 m apart. Near the second leg the foot stays on the first."""
    bend = np.linspace(-np.pi / 2, np.pi / 2, 20)
    X = np.concatenate((np.arange(0.0, 50.0), 50 + 3 * np.cos(bend), np.arange(49.0, 0.0, -1)))
    Y = np.concatenate((np.zeros(50), 3 + 3 * np.sin(bend), np.full(49, 6.0)))
    path = reference_path.build(world.path(X, Y, 10.0))
    assert reference_path.project(path, 20.0, 4.0, 19.0, 10.0) == pytest.approx(20.0, abs=1e-6)
    assert reference_path.project(path, 20.0, 4.0, None, 10.0) > 80


@quick
@given(st.floats(0, 150), st.floats(-3, 3), st.sampled_from([1.0, 2.7, 5.0]))
def test_on_laps_the_foot_is_found_in_the_first_one(world, theta, left, step):
    path = reference_path.build(circle(world, 1, step, length=500.0))  # three laps and some
    X, Y = (R - left) * np.sin(theta / R), R - (R - left) * np.cos(theta / R)
    assert reference_path.project(path, X, Y, None, 10.0) == pytest.approx(theta, abs=1e-3)


def test_of_two_legs_the_first_counts_only_where_both_are_about_as_near(world):
    X = np.concatenate((np.arange(60.0), 60 + 4 * np.sin(np.linspace(0, np.pi, 13)[1:-1])))
    Y = np.concatenate((np.zeros(60), 4 - 4 * np.cos(np.linspace(0, np.pi, 13)[1:-1])))
    hairpin = world.path(np.append(X, 60 - np.arange(61.0)), np.append(Y, np.full(61, 8.0)), 10.0)
    path = reference_path.build(hairpin)

    def foot(y):
        return reference_path.project(path, 20.0, y, None, 10.0)

    assert foot(3.9) == foot(4.45) == pytest.approx(20.0, abs=1e-6)
    assert foot(4.55) == foot(6.0) == pytest.approx(path.length - 20.0, abs=1e-3)


@pytest.mark.parametrize('turn', [1, -1])
def test_errors_are_positive_to_the_left_and_behind(turn):
    pose = arc.Pose(0.0, 0.0, turn * np.pi / 2)
    left_of_it = -turn * 2.0
    assert arc.contouring_error(pose, left_of_it, 0.0) == pytest.approx(2.0)
    assert arc.lag_error(pose, 0.0, -turn * 3.0) == pytest.approx(3.0)


def modified_path(world, **columns):
    path = world.path(np.arange(0.0, 10.0), np.zeros(10), 10.0)
    for name, (index, value) in columns.items():
        column = getattr(path, name).copy()
        column[index] = value
        path = path._replace(**{name: column})
    return path


@pytest.mark.parametrize(
    ('fault', 'message'),
    [
        ({'X': (4, np.nan)}, 'pose 4: X is not finite'),
        ({'t': (5, np.inf)}, 'pose 5: t is not finite'),
        ({'t': (6, 0.1)}, 'pose 5: the stamp does not increase'),
        ({'X': (3, 2.0)}, 'pose 2: the next pose is at the same place'),
        ({'X': (1, 1e-170)}, 'pose 0: the next pose is at the same place'),
        ({'X': (5, 3.5)}, 'pose 3: the path doubles back'),
        ({'psi': (2, np.pi)}, 'pose 2: its heading points backwards'),
        ({'psi': (9, 3.0)}, 'pose 8: the next heading points backwards'),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else None,
)
def test_a_path_that_cannot_be_driven_is_rejected_and_the_pose_named(world, fault, message):
    with pytest.raises(PathError, match=message):
        reference_path.build(modified_path(world, **fault))


def test_a_last_pose_that_is_repeated_is_a_stop(world):
    path = modified_path(world)
    stop = path._replace(**{f: np.append(getattr(path, f), getattr(path, f)[-1]) for f in 'XY'})
    stop = stop._replace(psi=np.append(path.psi, path.psi[-1]), t=np.append(path.t, path.t[-1] + 1))
    without, built = reference_path.build(path), reference_path.build(stop)
    assert not without.ends_in_stop
    assert built.ends_in_stop
    assert np.array_equal(built.table[:-1], without.table[:-1])
    _, v = reference_path.arcs_at(built, np.array([built.length - 0.1, built.length + 0.1]))
    assert v == pytest.approx([10.0, 0.0])


def test_a_speed_that_falls_to_walking_pace_is_a_stop(world):
    path = modified_path(world, t=(9, 2.0))
    assert reference_path.build(path).ends_in_stop


def test_one_pose_is_no_path(world):
    path = modified_path(world)
    with pytest.raises(PathError, match='two poses or more'):
        reference_path.build(path._replace(**{f: getattr(path, f)[:1] for f in path._fields[1:]}))
