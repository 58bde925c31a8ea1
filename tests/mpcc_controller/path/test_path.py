"""The path as arcs, the foot of a point, and path coordinates, against plane geometry."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mpcc_controller.path import (
    arc,
    compiled_queries,
    frenet_frame,
    reference_path,
    road_edges,
)
from mpcc_controller.path.arc import Arc
from mpcc_controller.path.distance import Disc
from mpcc_controller.path.frenet_frame import FrenetPoint
from mpcc_controller.path.reference_path import PathError
from msgs_yaml.types import Reference, RoadEdges

quick = settings(max_examples=60)
R, V = 20.0, 9.0
seeds = st.integers(0, 2**32 - 1)
turns = st.sampled_from([1.0, -1.0])


def poses(X, Y, psi=None, v=V):
    """Return a reference at a constant speed along a smooth line."""
    X, Y = np.asarray(X, float), np.asarray(Y, float)
    psi = np.unwrap(np.arctan2(np.gradient(Y), np.gradient(X))) if psi is None else psi
    return Reference(0, X, Y, psi, np.append(0, np.cumsum(np.hypot(np.diff(X), np.diff(Y)))) / v)


def on_circle(s, e=0.0, turn=1.0):
    """Return the point of the map at path coordinates of a circle from the origin eastwards."""
    reach = R - turn * e
    return reach * np.sin(s / R), turn * (R - reach * np.cos(s / R))


def circle(turn=1.0, length=160.0, step=0.5):
    s = np.arange(0.0, length, step)
    return reference_path.build(poses(*on_circle(s, turn=turn), turn * s / R))


def random_path(seed):
    """Return a generator, and a path of random chords; its radii are above 4 m."""
    rng = np.random.default_rng(seed)
    count, chord = rng.integers(2, 100), rng.choice([0.3, 2.0, 40.0])
    bend = rng.choice([0.0, 0.02, 0.2]) * min(chord, 1.0)
    psi = np.cumsum(rng.uniform(-bend, bend, count))
    mean = psi[:-1] + np.diff(psi) / 2
    X, Y = (np.append(0.0, np.cumsum(chord * f(mean))) for f in (np.cos, np.sin))
    t = np.cumsum(rng.uniform(0.01, 2.0, count))
    return rng, Reference(0, X, Y, psi, t), reference_path.build(Reference(0, X, Y, psi, t), 3.0)


@quick
@given(seeds)
def test_a_path_passes_its_poses_and_its_arcs_are_their_own_derivatives(seed):
    rng, given_poses, path = random_path(seed)
    theta = path.arcs.theta[1:]
    nodes, _ = reference_path.arcs_at(path, theta)
    for name in ('X', 'Y', 'psi'):
        assert getattr(nodes, name) == pytest.approx(getattr(given_poses, name), abs=1e-7), name
    segment = rng.integers(len(theta) - 1, size=20)
    inside = theta[segment] + rng.uniform(0.01, 0.99, 20) * np.diff(theta)[segment]
    h = 1e-4
    here, v = reference_path.arcs_at(path, inside)
    before, after = (reference_path.arcs_at(path, inside + side * h)[0] for side in (-1, 1))
    slopes = [(b - a) / (2 * h) for a, b in zip(before[:3], after[:3])]
    expected = np.cos(here.psi), np.sin(here.psi), here.kappa
    for slope, other in zip(slopes, expected):
        assert slope == pytest.approx(other, abs=1e-5)
    ds, dt = np.diff(theta)[segment], np.diff(given_poses.t)[segment]
    assert v == pytest.approx(ds / dt)
    one, _ = reference_path.arcs_at(path, inside[0])
    assert tuple(one) == tuple(column[0] for column in here)
    pose = arc.pose_at(Arc(*(column[0] for column in here)), theta[segment[0]])
    assert np.allclose(pose[:2], (nodes.X[segment[0]], nodes.Y[segment[0]]), atol=1e-5)


def test_beyond_its_ends_a_path_goes_straight_on_at_its_last_speeds():
    path = circle()
    (X, Y, psi, kappa, _), v = reference_path.arcs_at(path, np.array([-10.0, path.length + 10.0]))
    end = path.length / R
    x, y = on_circle(path.length)
    assert pytest.approx([-10.0, x + 10 * np.cos(end)], abs=1e-5) == X
    assert pytest.approx([0.0, y + 10 * np.sin(end)], abs=1e-5) == Y
    assert psi == pytest.approx([0.0, end], abs=1e-6)
    assert list(kappa) == [0, 0]
    assert v == pytest.approx([V, V], rel=1e-3)


def test_a_path_without_stamps_has_the_speed_of_the_parameter_and_else_names_it():
    timed = poses(*on_circle(np.arange(0.0, 50.0)))
    still = timed._replace(t=0.0 * timed.t)
    _, v = reference_path.arcs_at(reference_path.build(still, 12.5), np.array([-5.0, 40.0, 999.0]))
    assert v.tolist() == [12.5, 12.5, 12.5]
    both = reference_path.build(timed, 12.5), reference_path.build(timed)
    assert np.array_equal(*(path.table for path in both))
    with pytest.raises(PathError, match=r'surroundings\.path_speed_mps'):
        reference_path.build(still)


def straight(**columns):
    """Return ten poses along x, 1 m apart; columns are changed at an index."""
    path = poses(np.arange(0.0, 10.0), np.zeros(10), v=10.0)
    for name, (index, value) in columns.items():
        getattr(path, name)[index] = value
    return path


@pytest.mark.parametrize(
    ('path', 'message'),
    [
        (straight(X=(4, np.nan)), 'pose 4: X is not finite'),
        (straight(t=(5, np.inf)), 'pose 5: t is not finite'),
        (straight(t=(6, 0.1)), 'pose 5: the stamp does not increase'),
        (straight(X=(3, 2.0)), 'pose 2: the next pose is at the same place'),
        (straight(X=(1, 1e-170)), 'pose 0: the next pose is at the same place'),
        (straight(X=(5, 3.5)), 'pose 3: the path doubles back'),
        (straight(psi=(2, np.pi)), 'pose 2: its heading points backwards'),
        (straight(psi=(9, 3.0)), 'pose 8: the next heading points backwards'),
        (Reference(0, *(np.zeros(1) for _ in range(4))), 'two poses or more'),
    ],
)
def test_a_path_that_cannot_be_driven_is_rejected_and_the_pose_named(path, message):
    with pytest.raises(PathError, match=message):
        reference_path.build(path)


def test_a_repeated_last_pose_and_walking_pace_at_the_end_are_a_stop():
    path = straight()
    repeated = Reference(0, *(np.append(column, column[-1]) for column in path[1:4]), None)
    stop = reference_path.build(repeated._replace(t=np.append(path.t, path.t[-1] + 1)))
    without = reference_path.build(path)
    assert (without.ends_in_stop, stop.ends_in_stop) == (False, True)
    assert np.array_equal(stop.table[:-1], without.table[:-1])
    _, v = reference_path.arcs_at(stop, np.array([stop.length - 0.1, stop.length + 0.1]))
    assert v == pytest.approx([10.0, 0.0])
    assert reference_path.build(straight(t=(9, 2.0))).ends_in_stop


def beside(path, s, e):
    return frenet_frame.to_cartesian(path, FrenetPoint(np.atleast_1d(s), e))[:2]


@quick
@given(seeds, st.floats(-2.0, 2.0), st.floats(-20.0, 20.0))
def test_path_coordinates_of_a_point_and_back_are_the_identity_also_beyond_both_ends(
    seed, e, beyond
):
    rng, _, path = random_path(seed)
    s = np.append(rng.uniform(0.0, path.length, 20), [min(beyond, 0), path.length + abs(beyond)])
    X, Y = beside(path, s, e)
    # an arc ends some 20 micrometres beside the next pose where the path winds most
    allowed = np.append(np.full(20, 1e-6), [1e-4, 1e-4])
    refined = frenet_frame.refine(path, X, Y, s + rng.uniform(-0.3, 0.3, len(s)))
    assert np.all(np.abs(refined.s - s) <= allowed)
    assert np.all(np.abs(refined.e - e) <= allowed)
    for k, near in enumerate(s + rng.uniform(-1, 1, len(s))):
        foot = reference_path.project(path, X[k], Y[k], near, 3.0)
        assert foot == pytest.approx(s[k], abs=allowed[k])
        if abs(e) < 0.5:  # elsewhere another part of a winding path may be closer
            point = frenet_frame.to_frenet(path, X[k : k + 1], Y[k : k + 1], near)
            assert (point.s[0], point.e[0]) == pytest.approx((s[k], e), abs=allowed[k])
    # of many points at once each has the same
    point = frenet_frame.to_frenet(path, X, Y, s[0])
    alone = [frenet_frame.to_frenet(path, X[[k]], Y[[k]], s[0]) for k in range(len(X))]
    assert np.array_equal(np.transpose(point), np.reshape(alone, (-1, 2)))


@quick
@given(seeds)
def test_rows_are_interpolated_as_by_numpy(seed):
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.uniform(0.0, 1.0, (3, 8)), axis=1)
    values, x = rng.standard_normal((3, 8)), rng.uniform(-1.0, 6.0, (3, 20))
    x[:, :8] = points
    found = compiled_queries.interpolate(x, points, values)
    assert np.array_equal(found, [np.interp(*row) for row in zip(x, points, values)])


@quick
@given(st.floats(0, 110), st.floats(-9, 9), st.sampled_from([0.5, 2.7, 5.0]), turns)
def test_beside_a_circle_of_some_laps_the_coordinates_are_those_of_trigonometry(s, e, step, turn):
    path, lap = circle(turn, 500.0, step), 2 * np.pi * R
    X, Y = on_circle(s, e, turn)
    # the first lap counts, or that near the car
    assert reference_path.project(path, X, Y, None, 10.0) == pytest.approx(s, abs=1e-3)
    for laps in (0, 1, 2):
        near = s + laps * lap
        point = frenet_frame.to_frenet(path, np.array([X]), np.array([Y]), near)
        assert (point.s[0], point.e[0]) == pytest.approx((near, e), abs=2e-3)


def test_the_foot_does_not_jump_to_the_other_leg_of_a_hairpin():
    """Both legs are 8 m apart; of the whole path the first leg counts while about as near."""
    bend = np.linspace(-np.pi / 2, np.pi / 2, 20)
    X = np.concatenate((np.arange(60.0), 60 + 4 * np.cos(bend), np.arange(59.0, -1.0, -1)))
    Y = np.concatenate((np.zeros(60), 4 + 4 * np.sin(bend), np.full(60, 8.0)))
    path = reference_path.build(poses(X, Y))

    def foot(y, near=None):
        return reference_path.project(path, 20.0, y, near, 10.0)

    assert foot(6.0, near=19.0) == pytest.approx(20.0, abs=1e-6)
    assert foot(3.9) == foot(4.45) == pytest.approx(20.0, abs=1e-6)
    assert foot(4.55) == foot(6.0) == pytest.approx(path.length - 20.0, abs=1e-3)
    assert reference_path.project(path, -7.0, 1.0, None, 10.0) == pytest.approx(-7.0)


def test_positions_that_are_not_finite_give_values_that_are_not_finite():
    path, nowhere = circle(), np.array([np.nan])
    assert not np.isfinite(reference_path.arcs_at(path, nowhere)[0].X).any()
    assert not np.isfinite(frenet_frame.refine(path, nowhere, nowhere, nowhere).e).any()


@quick
@given(st.floats(20.0, 60.0), st.floats(-3.0, 3.0), st.floats(-2.0, 2.0))
def test_a_single_arc_gives_the_coordinates_of_a_point_metres_ahead_of_it(s, e, ahead):
    X, Y = on_circle(s - ahead)
    piece = Arc(X, Y, (s - ahead) / R, 1 / R, s - ahead)
    point = frenet_frame.to_frenet_on_arc(piece, *on_circle(s, e))
    assert (point.s, point.e) == pytest.approx((s, e), abs=1e-6)
    straight_on = frenet_frame.to_frenet_on_arc(piece._replace(psi=0.0, kappa=0.0), X + 3, Y - 2)
    assert straight_on == pytest.approx((s - ahead + 3, -2.0))


def test_the_offset_of_a_converging_edge_is_measured_on_the_normal_of_the_path():
    """The path runs at 20 deg through a road along x: the edge is not met where it is nearest."""
    psi, s = np.radians(20.0), np.arange(0.0, 20.0)
    path = reference_path.build(poses(s * np.cos(psi), s * np.sin(psi)))
    sides = (np.array([[-50.0, y], [90.0, y]]) for y in (9.0, -3.0))
    pieces, _ = reference_path.arcs_at(path, np.array([5.0, 10.0]))
    edges = frenet_frame.edges_to_frenet(road_edges.build(RoadEdges(0, *sides)), pieces, 2.0)
    heights = np.array([5.0, 10.0]) * np.sin(psi)
    for edge, y in ((edges.left, 9.0), (edges.right, -3.0)):
        assert edge.e == pytest.approx((y - heights) / np.cos(psi), abs=1e-9)
        assert edge.slope == pytest.approx(np.full(2, -np.tan(psi)), abs=1e-9)
    # hence the edge is a straight line in path coordinates
    assert frenet_frame.edge_offset(edges.left, 10.0)[0] == pytest.approx(edges.left.e[1])


def test_a_moving_obstacle_moves_along_the_path_and_a_resting_one_stays():
    t = 0.05 * np.arange(51)
    X, Y = on_circle(30.0 + 8.0 * t, 1.5)
    s, e, _ = frenet_frame.disc_to_frenet(circle(), Disc(X, Y, 1.0), 30.0)
    assert s == pytest.approx(30.0 + 8.0 * t, abs=1e-3)
    assert e == pytest.approx(np.full(51, 1.5), abs=1e-3)
    s, *_ = frenet_frame.disc_to_frenet(circle(), Disc(0 * t + X[0], 0 * t + Y[0], 1.0), 30.0)
    assert s == pytest.approx([30.0], abs=1e-3)
