"""Patches of another friction: from stripes along the road to quadrilaterals in the frame map.

A stripe lies between two stations of the centre line and two offsets from it. On a bend its long
sides are curves; it is cut across the road into as few quadrilaterals as keep their sides closer
than 5 cm to those curves. Neighbours share a side, so nothing is left open between them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scenario_publisher import line, schema
from scenario_publisher.line import Frame, Line
from scenario_publisher.shape import Fail

KEY = 'friction_patches'
MOST = 16  # quadrilaterals that a plant takes
SAGITTA = 0.05  # m, between a side of a quadrilateral and the curve it stands for
STEP = 0.05  # m of station between samples of a stripe
# between samples a curve strays up to 1.3 mm from its chord (0.2 1/m seen from 100 m outside)
SEEN_SAGITTA = SAGITTA - 0.002  # m, of the samples
# rad; with its sides within this of the heading at both ends, a quadrilateral is convex
MAX_TURN = 1.0
SMALLEST = 0.1  # m, length and width of a patch
TIGHTEST = 0.05  # length of a side to length of the centre line, inside of a bend


class Patches(NamedTuple):
    """Convex quadrilaterals and the friction on each, flat; the last one that holds a point counts.

    Corners are x1, y1, ..., x4, y4 in the frame map, counter-clockwise, eight numbers per friction.
    """

    corners_m: tuple[float, ...] = ()
    friction: tuple[float, ...] = ()  # in place of the road's, 1 is dry


class Stripe(NamedTuple):
    """A patch sampled along the road, n samples."""

    psi: np.ndarray  # rad (n,), heading of the centre line
    right: np.ndarray  # m (n, 2), side with the smaller offset
    left: np.ndarray  # m (n, 2)


def make(given: Sequence[schema.FrictionPatch], centre: Line, fail: Fail) -> Patches:
    """Return the patches of the file, in its order, on a road with a centre line.

    Raises what `fail` returns when one is empty, lies beyond the road, folds back inside a bend, or
    when they need more quadrilaterals than there may be.
    """
    if len(given) > MOST:
        raise fail(KEY, f'has {len(given)} patches; allowed at most {MOST}')
    corners, friction = [], []
    for i, patch in enumerate(given):
        key = f'{KEY}[{i}]'
        _refuse_misplaced(patch, key, centre, fail)
        left_over = MOST - len(friction)
        quads = _quadrilaterals(_stripe(patch, key, centre, fail), left_over)
        if len(quads) > left_over:
            what = f'needs more than {left_over} quadrilaterals to follow the road'
            then = f'allowed {MOST} for all patches, {len(friction)} are taken by those before'
            raise fail(key, f'{what}; {then}')
        corners += quads.ravel().tolist()
        friction += [patch.friction] * len(quads)
    return Patches(tuple(corners), tuple(friction))


def _refuse_misplaced(patch, key, centre, fail):
    spans = ('from_m', 'to_m'), ('from_offset_m', 'to_offset_m')
    for low, high in spans:
        first, last = getattr(patch, low), getattr(patch, high)
        if last - first < SMALLEST - line.ROUNDING:
            what = f'is {last:g} m, not {SMALLEST:g} m beyond {low}'
            raise fail(f'{key}.{high}', f'{what}; allowed {first + SMALLEST:g} m or more')
    if patch.to_m > centre.s[-1]:
        what = f'lies beyond the road with {patch.to_m:g}'
        raise fail(f'{key}.to_m', f'{what}; allowed up to {centre.s[-1]:.2f} m')


def _stripe(patch, key, centre, fail):
    count = 1 + int(np.ceil((patch.to_m - patch.from_m) / STEP))
    s = np.linspace(patch.from_m, patch.to_m, count)
    frame = line.at(centre, s)
    sides = {}
    for name in ('from_offset_m', 'to_offset_m'):
        side = np.column_stack(line.beside(frame, getattr(patch, name)))
        _refuse_fold(side, s, frame, f'{key}.{name}', fail)
        sides[name] = side
    return Stripe(frame.psi, sides['from_offset_m'], sides['to_offset_m'])


def _refuse_fold(side, s, frame: Frame, key, fail):
    psi = (frame.psi[:-1] + frame.psi[1:]) / 2
    dX, dY = np.diff(side, axis=0).T
    stretch = (dX * np.cos(psi) + dY * np.sin(psi)) / np.diff(s)
    i = int(np.argmin(stretch))
    if stretch[i] < TIGHTEST:
        what = f'folds back in the bend at station {s[i]:.1f} m'
        raise fail(key, f'{what}; allowed less than {1 - TIGHTEST:g} of the radius')


def _quadrilaterals(stripe, most):
    """Return corners (k, 4, 2); k is `most` + 1 when more than `most` are needed."""
    cuts = [0]
    while cuts[-1] < len(stripe.psi) - 1 and len(cuts) <= most + 1:
        cuts.append(_farthest(stripe, cuts[-1]))
    begin, end = cuts[:-1], cuts[1:]
    right, left = stripe.right, stripe.left
    return np.stack([right[begin], right[end], left[end], left[begin]], axis=1)


def _farthest(stripe, begin):
    """Return the sample to which a quadrilateral can reach: doubled steps, then halved ones."""
    last = len(stripe.psi) - 1
    end, step = begin + 1, 1
    while end < last and _fits(stripe, begin, min(end + step, last)):
        end = min(end + step, last)
        step *= 2
    while step > 1:
        step //= 2
        if end + step <= last and _fits(stripe, begin, end + step):
            end += step
    return end


def _fits(stripe, begin, end):
    psi, right, left = (column[begin : end + 1] for column in stripe)
    return np.ptp(psi) < MAX_TURN and max(_sagitta(right), _sagitta(left)) < SEEN_SAGITTA


def _sagitta(points):
    from_first = points - points[0]
    x, y = from_first[-1]
    return np.abs(from_first @ [-y, x]).max() / np.hypot(x, y)
