"""Friction patches: from stripes along the road to quadrilaterals in the frame map.

A stripe lies between two stations of the centre line and two offsets from it. On a bend its long
sides are curves; it is cut across the road into as few quadrilaterals as keep their sides closer
than 5 cm to those curves. Neighbours share a side, so there is no gap between them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from scenario_publisher import lines, schema
from scenario_publisher.lines import Line
from scenario_publisher.road_geometry import MIN_STRETCH
from scenario_publisher.schema import KeyedError

KEY = 'friction_patches'
MAX_QUADRILATERALS = 16  # the plant takes no more
MAX_SAGITTA = 0.05  # m, between a side of a quadrilateral and its curve
STATION_STEP = 0.05  # m between samples of a stripe
# between samples a curve strays up to 1.3 mm from its chord (0.2 1/m seen from 100 m outside)
MAX_SAMPLED_SAGITTA = MAX_SAGITTA - 0.002  # m
# rad; with its sides within this of the heading at both ends, a quadrilateral is convex
MAX_TURN = 1.0
MIN_SIZE = 0.1  # m, length and width of a patch


class Patches(NamedTuple):
    """Convex quadrilaterals and the friction on each, flat; where they overlap, the last counts.

    Corners are x1, y1, ..., x4, y4 in the frame map, counter-clockwise, eight numbers per friction.
    """

    corners_m: tuple[float, ...] = ()
    friction: tuple[float, ...] = ()  # in place of the road's, 1 is dry


class Stripe(NamedTuple):
    """A patch sampled along the road, n samples."""

    psi: np.ndarray  # rad (n,), heading of the centre line
    right: np.ndarray  # m (n, 2), side with the smaller offset
    left: np.ndarray  # m (n, 2)


def build_patches(blocks: Sequence[schema.FrictionPatch], centre: Line) -> Patches:
    """Return the patches of the file, in its order, on a road with a centre line.

    Raises KeyedError when a patch is empty, lies beyond the road, folds back inside a bend,
    or when the patches need more quadrilaterals than the plant takes.
    """
    if len(blocks) > MAX_QUADRILATERALS:
        raise KeyedError(KEY, f'has {len(blocks)} patches; allowed at most {MAX_QUADRILATERALS}')
    corners, friction = [], []
    for i, block in enumerate(blocks):
        key = f'{KEY}[{i}]'
        for low, high in (('from_m', 'to_m'), ('from_offset_m', 'to_offset_m')):
            first, last = getattr(block, low), getattr(block, high)
            if last - first < MIN_SIZE - lines.ROUNDING:
                what = f'is {last:g} m, not {MIN_SIZE:g} m beyond {low}'
                raise KeyedError(f'{key}.{high}', f'{what}; allowed {first + MIN_SIZE:g} m or more')
        if block.to_m > centre.s[-1]:
            what = f'lies beyond the road with {block.to_m:g}'
            raise KeyedError(f'{key}.to_m', f'{what}; allowed up to {centre.s[-1]:.2f} m')
        free = MAX_QUADRILATERALS - len(friction)
        quads = _quadrilaterals(_stripe(block, key, centre), free)
        if len(quads) > free:
            what = f'needs more than {free} quadrilaterals to follow the road'
            allowed = f'allowed {MAX_QUADRILATERALS} for all patches'
            raise KeyedError(key, f'{what}; {allowed}, {len(friction)} are taken by those before')
        corners += quads.ravel().tolist()
        friction += [block.friction] * len(quads)
    return Patches(tuple(corners), tuple(friction))


def _stripe(block, key, centre):
    count = 1 + int(np.ceil((block.to_m - block.from_m) / STATION_STEP))
    s = np.linspace(block.from_m, block.to_m, count)
    frame = lines.pose_at(centre, s)
    sides = {}
    for name in ('from_offset_m', 'to_offset_m'):
        side = np.column_stack(lines.offset_point(frame, getattr(block, name)))
        psi = (frame.psi[:-1] + frame.psi[1:]) / 2
        dX, dY = np.diff(side, axis=0).T
        stretch = (dX * np.cos(psi) + dY * np.sin(psi)) / np.diff(s)
        i = int(np.argmin(stretch))
        if stretch[i] < MIN_STRETCH:
            what = f'folds back in the bend at station {s[i]:.1f} m'
            allowed = f'allowed less than {1 - MIN_STRETCH:g} of the radius'
            raise KeyedError(f'{key}.{name}', f'{what}; {allowed}')
        sides[name] = side
    return Stripe(frame.psi, sides['from_offset_m'], sides['to_offset_m'])


def _quadrilaterals(stripe, limit):
    """Return corners (k, 4, 2); k is `limit` + 1 when more than `limit` are needed."""
    cuts = [0]
    while cuts[-1] < len(stripe.psi) - 1 and len(cuts) <= limit + 1:
        cuts.append(_farthest_end(stripe, cuts[-1]))
    begin, end = cuts[:-1], cuts[1:]
    right, left = stripe.right, stripe.left
    return np.stack([right[begin], right[end], left[end], left[begin]], axis=1)


def _farthest_end(stripe, begin):
    """Return the last sample that one quadrilateral can reach: doubled steps, then halved ones."""
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
    return np.ptp(psi) < MAX_TURN and max(_sagitta(right), _sagitta(left)) < MAX_SAMPLED_SAGITTA


def _sagitta(points):
    from_first = points - points[0]
    x, y = from_first[-1]
    return np.abs(from_first @ [-y, x]).max() / np.hypot(x, y)
