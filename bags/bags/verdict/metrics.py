"""The numbers a run is compared by: one dictionary per drive, the form of `comparison.json`.

Stations ("at_m") are metres along the reference, `x_m` is the map's x. A number that has no
meaning in a run (no obstacle, no braking, no solve time) is None.
"""

import numpy as np

from bags.verdict import control_loss, ending, geometry, handling, judge, off_road
from bags.verdict import drive as drives

BRAKING_N = -500.0  # the longitudinal force from which a car counts as braking
HARD_BRAKING_N = -1500.0
NOTICEABLE_M = 0.1  # an excursion below this is tracking, not an overshoot
BEND_1PM = 1e-3  # the curvature from which a piece of reference is a bend
REACHED_M = 0.1  # how closely the stop has to be reached
PASSED_M = 1.0  # two laps pass the stop equally closely, but for the sampling of the path


def of(drive):
    """Return every metric of a drive by name."""
    drive = drives.finite(drive)
    return of_series(drive, judge.series(drive))


def of_series(drive, s):
    """Return every metric of a drive of finite numbers whose Series is known."""
    found = _numbers(drive, s)
    return {'verdict': ending.text(drive, s, found), **found}


def _numbers(drive, s):
    facts, acc = drive.facts, drive.accelerations
    v2o = {str(i): _smallest(gap) for i, gap in s.v2o.items()}
    v2e = {side: _smallest(gap) for side, gap in s.v2e.items()}
    min_v2o = min((gap for gap in v2o.values() if gap is not None), default=None)
    min_v2e = min(v2e.values())
    finish = finish_station(drive, s)
    outline = _smallest(s.outline_gap)
    slip_deg, slip_at = peak_sideslip(s)
    return {
        'completed': completed(drive, s, finish),
        'finish_at_m': finish,
        'collided': any(gap is not None and gap < 0.0 for gap in (min_v2o, outline)),
        'collided_by': _collided_by(min_v2o, outline),
        **off_road.found(drive, s),
        **control_loss.found(s),
        'entered_unsafe_area': (min_v2o is not None and min_v2o < facts.safe_obstacle)
        or min_v2e < facts.safe_edge,
        'min_v2o_m': min_v2o,
        'min_v2o_per_obstacle_m': v2o,
        'min_v2e_m': min_v2e,
        'min_v2e_per_edge_m': v2e,
        'min_outline_gap_m': outline,
        'overshoots': overshoots(drive, s),
        'peak_brake_mps2': max(0.0, -float(np.min(acc.ax))) if acc.ax.size else None,
        'peak_sideslip_deg': slip_deg,
        'peak_sideslip_at_m': slip_at,
        'min_speed_mps': float(np.min(s.speed)),
        'brake_onset_at_m': brake_onset(drive, s, BRAKING_N),
        'brake_onset_hard_at_m': brake_onset(drive, s, HARD_BRAKING_N),
        'braking_s': handling.braking_time(drive, BRAKING_N),
        **handling.counter_steer(drive),
        'peak_lat_acc_mps2': float(np.max(np.abs(acc.ay))) if acc.ay.size else None,
        **handling.shares(drive),
        'rms_contouring_m': float(np.sqrt(np.mean(s.contouring**2))),
        'solve_ms': solve_times(drive.ticks.solve_ms),
        'solve_cpu_ms': solve_times(drive.ticks.solve_cpu_ms),
        **tick_counts(drive),
    }


def _smallest(values):
    """Return the smallest finite value, or None."""
    finite = values[np.isfinite(values)]
    return float(finite.min()) if finite.size else None


def _collided_by(min_v2o, outline):
    """Return what touched an obstacle: the outline, or only the circles of the car, or None."""
    if outline is not None and outline < 0.0:
        return ending.OUTLINE
    return ending.CIRCLE if min_v2o is not None and min_v2o < 0.0 else None


def finish_station(drive, s):
    """Return the station [m] that completes a drive."""
    from_m = float(s.station[0]) + drive.facts.armed_after
    return stop_station(drive.scene.reference, drive.facts.stop, from_m)


def completed(drive, s, finish):
    """Tell whether the car reached the station `finish` [m] on the road.

    On the road are vehicle circles whose centres lie between the edges: who passes the finish line
    beside the road has not reached it, nor has who starts beyond it.
    """
    centres = np.min([*s.v2e.values()], axis=0) + drive.facts.vehicle_radius
    reached = np.any((s.station >= finish) & (centres > 0.0))
    return bool(reached and s.station[0] < finish)


def stop_station(reference, stop, from_m):
    """Return the station [m] that completes a run: that of the stop, but for REACHED_M.

    The road may pass the stop more than once; the first time beyond `from_m` counts. Where it does
    not pass it again, it is the station at which it passed it.
    """
    vertex, place = geometry.arc_length(reference), np.array([stop])
    first = int(np.searchsorted(vertex, from_m - REACHED_M)) - 1
    first = min(max(0, first), len(vertex) - 2)
    ahead = geometry.track(place, reference[first:], judge.AHEAD)
    anywhere = geometry.track(place, reference, judge.AHEAD)
    if abs(ahead.offset[0]) > abs(anywhere.offset[0]) + PASSED_M:
        return float(anywhere.distance[0] - REACHED_M)
    return float(vertex[first] + ahead.distance[0] - REACHED_M)


def peak_sideslip(s):
    """Return the largest sideslip angle [deg], without sign, and the station of it [m]."""
    if np.all(np.isnan(s.sideslip)):
        return None, None
    k = int(np.nanargmax(np.abs(s.sideslip)))
    return float(np.degrees(np.abs(s.sideslip[k]))), float(s.station[k])


def brake_onset(drive, s, force_n):
    """Return the station [m] at which the actuated force first falls to `force_n`, or None."""
    below = np.flatnonzero(drive.inputs.force <= force_n)
    if not below.size:
        return None
    stamp_ns = drive.inputs.stamp_ns[below[0]]
    return float(np.interp(stamp_ns, drive.motion.stamp_ns, s.station))


def overshoots(drive, s):
    """Return where the vehicle ran wide: [{x_m, amount_m}] in driving order.

    The reference is a sequence of bends; the outer side of a bend is the one it turns away from,
    and a bend rules until the next one begins. An excursion is the stretch of the drive between
    two crossings of the reference. It is an overshoot when it lies on the outer side of the bend
    that rules where it begins or where it is widest, and is wider than NOTICEABLE_M: so is
    entering a lane change late, and swinging beyond the line at its end, but not cutting a corner.
    """
    starts, turns = _bends(drive.scene.reference)
    side = np.sign(s.contouring)
    crossings = np.flatnonzero(np.diff(side) != 0.0) + 1
    found = []
    for stretch in np.split(np.arange(len(side)), crossings):
        peak = stretch[np.argmax(np.abs(s.contouring[stretch]))]
        amount = float(np.abs(s.contouring[peak]))
        ruling = np.searchsorted(starts, s.station[[stretch[0], peak]], side='right') - 1
        wide = [k >= 0 and side[peak] == -turns[k] for k in ruling]
        if amount > NOTICEABLE_M and any(wide):
            found.append({'x_m': float(drive.motion.x[peak]), 'amount_m': amount})
    return found


def _bends(reference):
    """Return the stations [m] at which bends begin, and their turn: left 1, right -1."""
    along = geometry.arc_length(reference)
    steps = np.diff(reference, axis=0)
    yaw = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    middles = (along[1:] + along[:-1]) / 2
    curvature = np.diff(yaw) / np.diff(middles)
    turn = np.where(np.abs(curvature) > BEND_1PM, np.sign(curvature), 0.0)
    begins = (turn != 0.0) & (turn != np.concatenate([[0.0], turn[:-1]]))
    return along[1:-1][begins], turn[begins]


def solve_times(solve_ms):
    """Return mean, median, 99th percentile and maximum [ms]; None each without a solve."""
    names = ('mean', 'p50', 'p99', 'max')
    known = solve_ms[np.isfinite(solve_ms)]
    if not known.size:
        return dict.fromkeys(names)
    values = (known.mean(), *np.percentile(known, [50, 99]), known.max())
    return {name: float(value) for name, value in zip(names, values)}


def tick_counts(drive):
    """Return ticks, deadline misses and fallbacks.

    A tick is missed when no command carries a stamp of its period.
    """
    ticks, answered = periods(drive.motion.stamp_ns, drive.ticks.answered_ns, drive.facts.tick_ns)
    return {
        'ticks': ticks,
        'deadline_misses': ticks - answered,
        'fallbacks': int(np.count_nonzero(drive.ticks.fallback)),
    }


def periods(state_ns, answered_ns, period):
    """Return how many controller periods [ns] a drive has, and how many of them were answered.

    They count from the first answer: the car is held at its start until then. The period of the
    last state is left out: its answer may come after the end. Without any answer every period
    between the first state and the last one counts.
    """
    first, last = (-(-int(stamp) // period) for stamp in (state_ns.min(), state_ns.max()))
    answered = np.unique(answered_ns // period)
    answered = answered[(answered >= first) & (answered < last)]
    first = int(answered[0]) if answered.size else first
    return last - first, len(answered)
