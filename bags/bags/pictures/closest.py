"""The moments next to each obstacle, enlarged within the panel of the distances to obstacles."""

import numpy as np

from bags.pictures import palette

NEAR_M = 1.2  # distances up to this are enlarged
BELOW_M = 0.35  # shown below the smallest one, so that the collision area is seen
ASIDE_M = 14.0  # m of stations taken by the curves either side of a closest approach
LEAST_SHARE = 0.15  # of the width; in a narrower gap nothing is enlarged
FILL = 0.72  # of a gap, the rest is for the labels left of it
TICKS_M = (0.0, 0.5, 1.0)
BOTTOM, HEIGHT = 0.44, 0.46  # of the panel


def unsafe(ax, safe):
    """Shade the unsafe area below the safety distance [m], darker where the circles overlap."""
    ax.axhspan(0.0, safe, color=palette.UNSAFE, alpha=0.22, lw=0)
    ax.axhspan(-100.0, 0.0, color=palette.COLLISION, alpha=0.18, lw=0)
    ax.axhline(safe, color=palette.UNSAFE, lw=0.8)
    ax.axhline(0.0, color=palette.COLLISION, lw=0.8)


def insets(ax, runs):
    """Enlarge the closest approach to every obstacle that has free room of the panel beside it."""
    approached = {}
    for run in runs:
        for number, gap in run.series.v2o.items():
            if np.any(gap < NEAR_M):
                station = float(run.series.station[np.nanargmin(gap)])
                approached.setdefault(number, []).append(station)
    middles = {number: float(np.mean(found)) for number, found in approached.items()}
    order = sorted(middles, key=middles.get)
    free = _gaps(ax.get_xlim(), [middles[number] for number in order])
    for k, number in enumerate(order):
        # one before and one behind the approach
        beside = [side for side in (k, k + 1) if side in free]
        if beside:
            widest = max(beside, key=lambda side: free[side][1] - free[side][0])
            _inset(ax, runs, number, free.pop(widest))


def _gaps(limits, middles):
    """Return the (from, to) stations [m] that no curve crosses by place, those wide enough."""
    low, high = limits
    begins = [low, *(middle + ASIDE_M for middle in middles)]
    ends = [*(middle - ASIDE_M for middle in middles), high]
    wide = LEAST_SHARE * (high - low)
    return {
        k: (begin, end) for k, (begin, end) in enumerate(zip(begins, ends)) if end - begin >= wide
    }


def _inset(ax, runs, number, gap):
    low, high = ax.get_xlim()
    width = FILL * (gap[1] - gap[0]) / (high - low)
    right = (gap[1] - low) / (high - low)
    inner = ax.inset_axes((right - width, BOTTOM, width, HEIGHT))
    reach, least = [], 0.0
    for run in runs:
        distance, station = run.series.v2o[number], run.series.station
        near = distance < NEAR_M
        if np.any(near):
            inner.plot(station[near], distance[near], **run.line)
            reach += [station[near].min(), station[near].max()]
            least = min(least, float(np.nanmin(distance)))
    unsafe(inner, max(run.drive.facts.safe_obstacle for run in runs))
    inner.set(xlim=(min(reach), max(reach)), ylim=(least - BELOW_M, NEAR_M))
    inner.set(yticks=TICKS_M)
    inner.set_title(f'obstacle {number}', fontsize=7.5, fontweight='normal', loc='center', pad=3.0)
    inner.tick_params(labelsize=6.5, length=2.0)
    inner.set_facecolor('white')
    for side in ('top', 'right'):
        inner.spines[side].set_visible(True)
