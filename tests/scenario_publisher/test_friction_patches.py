"""Friction patches: quadrilaterals that cover the stripe of road they were made from."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenario_publisher import lines
from scenario_publisher.friction_patches import MAX_QUADRILATERALS, MAX_SAGITTA, build_patches
from scenario_publisher.schema import FrictionPatch, KeyedError

ROUNDING = 1e-9
everywhere = settings(max_examples=60)
lengths = st.floats(5.0, 30.0)
curvatures = st.floats(-0.1, 0.1)
pieces = st.one_of(
    st.builds(lines.straight, lengths),
    st.builds(lines.arc, lengths, curvatures),
    st.builds(lines.clothoid, lengths, curvatures, curvatures),
    st.builds(lines.lane_change, st.floats(10.0, 30.0), st.floats(-1.5, 1.5)),
)


def road_of(*curves, at=(0.0, 0.0, 0.0)):
    return lines.line_from_curves(curves, *at, 1.0)


STRAIGHT = road_of(lines.straight(100.0), at=(5.0, -2.0, 0.7))
BEND = road_of(lines.straight(20.0), lines.arc(40.0, 0.02))


def patch(from_m, to_m, from_offset_m, to_offset_m, friction=0.3):
    names = ('from_m', 'to_m', 'from_offset_m', 'to_offset_m', 'friction')
    return dict(zip(names, (from_m, to_m, from_offset_m, to_offset_m, friction)))


def cut(centre, *given_patch):
    """Return the corners (k, 4, 2) of one patch."""
    patches = build_patches([FrictionPatch(**patch(*given_patch))], centre)
    return np.array(patches.corners_m).reshape(-1, 4, 2)


def depth(quads, s, offset, centre):
    """Return how deep [m] points at stations and offsets lie inside the best quadrilateral."""
    s, offset = (column.ravel() for column in np.meshgrid(s, offset))
    points = np.column_stack(lines.offset_point(lines.pose_at(centre, s), offset))
    edges = np.roll(quads, -1, axis=1) - quads
    inward = np.stack([-edges[..., 1], edges[..., 0]], axis=-1)
    inward /= np.hypot(edges[..., 0], edges[..., 1])[..., None]
    from_corner = points[:, None, None] - quads
    return np.sum(from_corner * inward, axis=-1).min(axis=2).max(axis=1)


def test_patch_on_a_straight_is_one_rectangle_beside_the_centre_line():
    (corners,) = cut(STRAIGHT, 40.0, 90.0, -1.0, 3.0)
    ahead, aside = np.array([np.cos(0.7), np.sin(0.7)]), np.array([-np.sin(0.7), np.cos(0.7)])
    wanted = [(40.0, -1.0), (90.0, -1.0), (90.0, 3.0), (40.0, 3.0)]
    exact = [[5.0, -2.0] + s * ahead + d * aside for s, d in wanted]
    assert corners == pytest.approx(np.array(exact), abs=1e-9)


@pytest.mark.parametrize('kappa', [0.02, -0.02, 0.1, -0.1])
@pytest.mark.parametrize(('right', 'left'), [(0.0, 6.0), (-6.0, 0.0), (-3.0, 4.0)])
def test_arc_is_cut_into_no_more_pieces_than_its_sagitta_asks_for(kappa, right, left):
    angle = 0.5
    centre = road_of(lines.arc(angle / abs(kappa), kappa))
    outer = max(1 / abs(kappa) - np.sign(kappa) * offset for offset in (right, left))
    count = len(cut(centre, 0.0, angle / abs(kappa) - ROUNDING, right, left))
    fewest = angle / (2 * np.arccos(1 - MAX_SAGITTA / outer))
    assert fewest <= count <= np.ceil(1.05 * fewest)


@everywhere
@given(
    curves=st.lists(pieces, min_size=1, max_size=3),
    share=st.tuples(st.floats(0.05, 0.4), st.floats(0.5, 0.95)),
    right=st.floats(-5.0, 3.0),
    width=st.floats(0.5, 4.0),
)
def test_pieces_cover_the_stripe_to_within_the_sagitta_and_nothing_else(
    curves, share, right, width
):
    centre = road_of(*curves)
    low, high = np.array(share) * min(centre.s[-1], 20.0)
    left = right + width
    quads = cut(centre, low, high, right, left)
    s = np.linspace(low, high, 301)
    well_inside = np.linspace(right + MAX_SAGITTA, left - MAX_SAGITTA, 7)
    assert depth(quads, s, well_inside, centre).min() >= -ROUNDING
    assert depth(quads, s, np.array([right, left]), centre).min() >= -MAX_SAGITTA
    beyond = np.array([right - MAX_SAGITTA, left + MAX_SAGITTA])
    assert depth(quads, s, beyond, centre).max() < 0.0
    across = np.linspace(right, left, 7)
    assert depth(quads, np.array([low - 0.01, high + 0.01]), across, centre).max() < 0.0


@everywhere
@given(
    kappa=st.floats(-0.2, 0.2),
    low=st.floats(0.0, 5.0),
    length=st.floats(0.1, 4.0),
    right=st.floats(-100.0, 4.0),
    width=st.floats(0.1, 30.0),
)
def test_every_piece_is_convex_with_sides_that_a_plant_can_tell_apart(
    kappa, low, length, right, width
):
    centre = road_of(lines.arc(10.0, kappa))
    try:
        quads = cut(centre, low, low + length, right, right + width)
    except KeyedError as caught:
        (_, refusal), quads = caught.args, np.empty((0, 4, 2))
    else:
        refusal = ''
    assert bool(len(quads)) != bool(re.match('folds back|needs more', refusal))
    edges = np.roll(quads, -1, axis=1) - quads
    after = np.roll(edges, -1, axis=1)
    assert np.all(np.hypot(*np.moveaxis(edges, -1, 0)) > 1e-3)
    assert np.all(edges[..., 0] * after[..., 1] - edges[..., 1] * after[..., 0] > 0.0)


def test_there_are_none_by_default_and_patches_keep_their_order_and_each_piece_its_friction(
    make, tree
):
    assert make(tree).patches == ((), ())
    tree['friction_patches'] = [patch(5, 30, 0, 4, 0.3), patch(40, 60, -4, 4, 0.6)]
    corners, friction = make(tree).patches
    pieces_of_bend = len(friction) - 1
    assert pieces_of_bend > 1
    assert friction == (0.3, *[0.6] * pieces_of_bend)
    assert corners[:8] == pytest.approx((5, 0, 30, 0, 30, 4, 5, 4))
    assert len(corners) == 8 * len(friction)
    assert {type(number) for number in (*corners, *friction)} == {float}


def test_as_many_patches_as_the_plant_takes_are_allowed(make, tree):
    tree['friction_patches'] = [patch(2 * i, 2 * i + 1, 0, 4) for i in range(MAX_QUADRILATERALS)]
    assert len(make(tree).patches.friction) == MAX_QUADRILATERALS
