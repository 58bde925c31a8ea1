"""Friction patches: quadrilaterals that cover the stripe of road they were made from."""

import re

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from scenario_publisher import lines
from scenario_publisher.friction_patches import MAX_QUADRILATERALS, MAX_SAGITTA, build_patches
from scenario_publisher.scenario import ScenarioError
from scenario_publisher.schema import FrictionPatch, KeyedError

LINE = re.compile(r'bend\.yaml:\d+: friction_patches[a-z_.\[\]0-9]*: .*; allowed ')
ROUNDING = 1e-9
everywhere = settings(
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
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


def test_point_left_of_the_centre_line_is_on_a_left_patch_and_one_on_the_right_is_not():
    quads = cut(STRAIGHT, 40.0, 90.0, 0.0, 3.0)
    on, off = [(40.1, 0.1), (65.0, 1.5), (89.9, 2.9)], [(65.0, -0.1), (39.9, 1.5), (90.1, 1.5)]
    assert all(depth(quads, *place, STRAIGHT) > 0.0 for place in on)
    assert all(depth(quads, *place, STRAIGHT) < 0.0 for place in [*off, (65.0, 3.1)])


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


def test_neighbours_share_a_side_so_that_no_wheel_falls_between():
    quads = cut(BEND, 10.0, 55.0, -3.0, 3.0)
    assert len(quads) > 2
    assert np.array_equal(quads[:-1, 1], quads[1:, 0])
    assert np.array_equal(quads[:-1, 2], quads[1:, 3])


def test_scenario_without_patches_has_none(make, tree):
    assert make(tree).patches == ((), ())
    tree['friction_patches'] = []
    assert make(tree).patches == ((), ())


def test_patches_keep_their_order_and_each_piece_its_friction(make, tree):
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


MISTAKES = {
    'friction': (patch(5, 9, 0, 4, 0.0), 'friction: is .* allowed 0.05 to 1.5'),
    'not finite': (patch(5, float('inf'), 0, 4), r'to_m: must be finite'),
    'not a number': (patch(5, 9, 0, float('nan')), 'to_offset_m: must be finite'),
    'before the road': (patch(-1, 9, 0, 4), 'from_m: is .* allowed 0 to 20000 m'),
    'beyond the road': (
        patch(5, 81, 0, 4),
        r'\[0\].to_m: lies beyond the road with 81; allowed up to 80.00 m',
    ),
    'backwards': (
        patch(9, 5, 0, 4),
        r'\[0\].to_m: is 5 m, not 0.1 m beyond from_m; allowed 9.1 m or more',
    ),
    'without length': (patch(5, 5, 0, 4), r'\[0\].to_m: is 5 m'),
    'left before right': (
        patch(5, 9, 4, 0),
        r'\[0\].to_offset_m: is 0 m, not 0.1 m beyond from_offset_m; allowed 4.1 m or more',
    ),
    'too far aside': (patch(5, 9, 0, 101), 'to_offset_m: is .* -100 to 100 m'),
    'beyond the centre of the bend': (
        patch(30, 60, 0, 49),
        r'\[0\].to_offset_m: folds back in the bend at station \d+.\d m; allowed less than 0.95',
    ),
    'unknown key': ({**patch(5, 9, 0, 4), 'mu': 1.0}, 'mu: unknown key; allowed from_m'),
    'no mapping': ([5, 9, 0, 4], 'must be a mapping'),
}


@pytest.mark.parametrize('mistake', MISTAKES)
def test_mistake_in_a_patch_is_named_with_line_key_and_what_is_allowed(make, tree, mistake):
    wrong, message = MISTAKES[mistake]
    tree['friction_patches'] = [wrong]
    with pytest.raises(ScenarioError, match=message) as caught:
        make(tree)
    assert '\n' not in str(caught.value)
    # what is no mapping has no range of its own
    assert LINE.match(str(caught.value)) or mistake == 'no mapping'


@pytest.mark.parametrize('key', patch(5, 9, 0, 4))
def test_missing_key_of_a_patch_is_named(make, tree, key):
    incomplete = patch(5, 9, 0, 4)
    del incomplete[key]
    tree['friction_patches'] = [incomplete]
    with pytest.raises(ScenarioError, match=rf'friction_patches\[0\].{key}: is missing; allowed'):
        make(tree)


def test_more_patches_than_the_plant_takes_are_refused(make, tree):
    # each a dict of its own: the same one again would be written as an alias
    tree['friction_patches'] = [patch(5, 9, 0, 4) for _ in range(MAX_QUADRILATERALS + 1)]
    with pytest.raises(ScenarioError, match='friction_patches: has 17 patches; allowed at most 16'):
        make(tree)


def test_patch_whose_pieces_no_longer_fit_is_the_one_that_is_named(make, tree):
    tree['friction_patches'] = [
        patch(2 * i, 2 * i + 1, 0, 4) for i in range(MAX_QUADRILATERALS - 2)
    ]
    tree['friction_patches'].append(patch(40, 80, 0, 4))
    what = (
        r'friction_patches\[14\]: needs more than 2 quadrilaterals to follow the road; '
        'allowed 16 for all patches, 14 are taken by those before'
    )
    with pytest.raises(ScenarioError, match=what):
        make(tree)


@everywhere
@given(numbers=st.lists(st.floats(-2.0, 90.0) | st.floats(), min_size=5, max_size=5))
def test_any_numbers_are_patches_the_plant_takes_or_a_named_error(make, tree, numbers):
    tree['friction_patches'] = [patch(*numbers)]
    try:
        corners, friction = make(tree).patches
    except ScenarioError as caught:
        message = str(caught)
    else:
        assert np.isfinite(corners).all()
        assert 1 <= len(friction) <= MAX_QUADRILATERALS
        message = 'bend.yaml:1: friction_patches: made; allowed '
    assert LINE.match(message)
