"""Whether a car went out of control: it slid sideways at a large angle, or spun.

Whether the true outline of a car reached beyond an edge of the road, where and how far.

How a car was handled: for how long it braked, steered against its turn, what grip it used.

How a run ended, in one line for a person.

The numbers a run is compared by: one dictionary per drive, the form of `comparison.json`.

Stations ("at_m") are metres along the reference, `x_m` is the map's x. A number that has no
meaning in a run (no obstacle, no braking, no solve time) is None.
"""

import numpy as np

from bags.evaluation import geometry
from bags.evaluation.drive import drop_nonfinite
from bags.evaluation.series import SEARCH_M, compute_series

SLIDING_DEG = 30.0  # sideslip that no controller here plans: twice that of the tyres' limit
SPUN_DEG = 90.0  # beyond it a car moves backwards


def control_loss(s):
    """Return {lost, lost_how, lost_at_m} of a Series.

    A car is lost when its sideslip angle exceeds SLIDING_DEG while it moves; `lost_how` is 'spun'
    when the angle exceeds SPUN_DEG later on, else 'sideslip'. The station [m] is where it began.
    """
    # not-a-number, of a car that hardly moves, exceeds nothing
    angle = np.degrees(np.abs(s.sideslip))
    beyond = np.flatnonzero(angle > SLIDING_DEG)
    if not beyond.size:
        return {'lost': False, 'lost_how': None, 'lost_at_m': None}
    how = 'spun' if np.any(angle > SPUN_DEG) else 'sideslip'
    return {'lost': True, 'lost_how': how, 'lost_at_m': float(s.station[beyond[0]])}


STEP_S = 0.01  # between two poses that are looked at
SPACING_M = 0.6  # between two points of the outline
INSIDE = {'left': -1.0, 'right': 1.0}  # sign of the road's side of an edge


def road_departure(drive, s):
    """Return {left_road, left_road_at_m, beyond_edge_m} of a drive and its Series.

    `left_road_at_m` is the station [m] at which the outline first reached beyond an edge,
    `beyond_edge_m` how far [m] its farthest point ever was beyond one; None on the road.
    """
    k, beyond = beyond_edge(drive, s)
    outside = np.flatnonzero(beyond > 0.0)
    if not outside.size:
        return {'left_road': False, 'left_road_at_m': None, 'beyond_edge_m': None}
    first = float(s.station[k[outside[0]]])
    return {'left_road': True, 'left_road_at_m': first, 'beyond_edge_m': float(beyond.max())}


def beyond_edge(drive, s):
    """Return indices (n,) of odometry messages, and how far [m] the outline is beyond an edge then.

    The farthest point counts; negative where the whole outline is inside, minus infinity where it
    is so far inside that nobody asked.
    """
    motion, outline = drive.motion, drive.facts.outline
    k = _samples(s.t)
    body = geometry.outline_points(outline, SPACING_M)
    # from the centre of gravity to the farthest point of the outline
    reach = np.hypot(max(outline.front, outline.rear), outline.width / 2)
    centre = np.column_stack([motion.x[k], motion.y[k]])
    beyond = np.full(len(k), -np.inf)
    for side, edge in (('left', drive.scene.left), ('right', drive.scene.right)):
        near = np.flatnonzero(INSIDE[side] * geometry.offset_from_line(centre, edge) < reach)
        if near.size:
            points = geometry.moved(body, *(column[k[near]] for column in motion[1:4]))
            inside = INSIDE[side] * geometry.offset_from_line(points.reshape(-1, 2), edge)
            farthest = -inside.reshape(len(near), -1).min(axis=1)
            beyond[near] = np.maximum(beyond[near], farthest)
    return k, beyond


def _samples(t):
    """Return the indices of samples that are STEP_S apart, the last one included."""
    chosen = np.searchsorted(t, np.arange(t[0], t[-1], STEP_S))
    return np.unique(np.append(chosen, len(t) - 1))


GRAVITY = 9.81  # m/s^2
SAMPLE_NS = 10_000_000
NS = 1e-9  # s
# below these a steering angle and a turn have no side: 1 deg at the road wheel, 3 deg/s
STEERED_RAD = np.radians(1.0)
TURNING_RADPS = np.radians(3.0)


def braking_time(drive, force_n):
    """Return for how long [s] the actuated force was at or below `force_n`; None without any."""
    if not drive.inputs.stamp_ns.size:
        return None
    stamps = _even_stamps(drive.inputs.stamp_ns)
    force = np.interp(stamps, drive.inputs.stamp_ns, drive.inputs.force)
    return float(np.count_nonzero(force <= force_n) * SAMPLE_NS * NS)


def counter_steer(drive):
    """Return how long [s] and how far [deg] the wheels were steered against the turn of the car.

    The steering angle and the yaw rate have unlike signs, both beyond what is noise. Every change
    of direction has a little of it, because the steering leads; a rear axle that slides has much.
    None each where no steering angle is known.
    """
    if not drive.inputs.stamp_ns.size:
        return {'counter_steer_s': None, 'peak_counter_steer_deg': None}
    stamps = _even_stamps(drive.motion.stamp_ns)
    steer = np.interp(stamps, drive.inputs.stamp_ns, drive.inputs.steer)
    yaw = np.interp(stamps, drive.motion.stamp_ns, np.unwrap(drive.motion.yaw))
    # two samples have one difference; a drive of one has none
    turn = np.gradient(yaw, SAMPLE_NS * NS) if len(yaw) > 1 else np.zeros(len(yaw))
    against = (steer * turn < 0) & (np.abs(turn) > TURNING_RADPS) & (np.abs(steer) > STEERED_RAD)
    return {
        'counter_steer_s': float(np.count_nonzero(against) * SAMPLE_NS * NS),
        'peak_counter_steer_deg': float(
            np.degrees(np.max(np.abs(steer), where=against, initial=0))
        ),
    }


def friction_shares(drive):
    """Return the peak accelerations as shares of what the friction of the road allows.

    None each where no acceleration was measured.
    """
    limit = drive.facts.friction * GRAVITY
    acc = drive.accelerations
    if not acc.stamp_ns.size:
        return {'peak_lat_acc_share': None, 'peak_brake_share': None}
    return {
        'peak_lat_acc_share': float(np.max(np.abs(acc.ay)) / limit),
        'peak_brake_share': max(0.0, -float(np.min(acc.ax)) / limit),
    }


def _even_stamps(stamp_ns):
    return np.arange(stamp_ns.min(), stamp_ns.max() + 1, SAMPLE_NS)


STANDING_MPS = 0.5  # below this speed a car stands
CIRCLE, OUTLINE = 'circle', 'outline'
TOO_SLOW = 'too_slow'  # reason of the controller, see docs/safety.md


def describe_outcome(drive, s, found):
    """Return how a run ended; `found` are its other metrics, `s` is its Series."""
    parts = [
        _end_text(drive, s, found),
        *_lost_text(found),
        *_road_text(found),
        *_collision_text(found, s),
    ]
    if not drive.ticks.answered_ns.size:
        parts.append('no command answered a state')
    return '; '.join(parts)


def _end_text(drive, s, found):
    if found['completed']:
        return f'reached the finish line at {found["finish_at_m"]:.0f} m'
    if s.station[0] >= found['finish_at_m']:
        return 'started beyond the finish line'
    if s.station.max() >= found['finish_at_m']:
        return f'passed the finish line beside the road at {found["finish_at_m"]:.0f} m'
    station, speed = s.station[-1], s.speed[-1]
    if speed < STANDING_MPS:
        return f'stood still at {station:.0f} m{_reason(drive)}'
    return f'did not reach the finish line: ended at {station:.0f} m with {speed:.1f} m/s'


def _reason(drive):
    reason, least = drive.ticks.last_reason, drive.facts.least_speed
    if not reason:
        return ''
    below = f': below {least:g} m/s it only brakes' if reason == TOO_SLOW and least else ''
    return f' (reason of the controller: {reason}{below})'


def _lost_text(found):
    if found['lost_how'] == 'spun':
        yield f'spun at {found["lost_at_m"]:.0f} m'
    elif found['lost']:
        peak = found['peak_sideslip_deg']
        yield f'slid at {found["lost_at_m"]:.0f} m (sideslip angle up to {peak:.0f} deg)'


def _road_text(found):
    if found['left_road']:
        where, far = found['left_road_at_m'], found['beyond_edge_m']
        yield f'left the road at {where:.0f} m, by up to {far:.2f} m'


def _collision_text(found, s):
    """Yield what was hit; circles may overlap though the outline passes."""
    if not found['collided']:
        yield 'no collision'
    for number, gap in s.outline_gaps.items():
        outline, circle = _smallest_finite(gap), found['min_v2o_per_obstacle_m'][str(number)]
        if outline is not None and outline < 0.0:
            yield f'collided with obstacle {number} (outline, overlap {-outline:.2f} m)'
        elif circle is not None and circle < 0.0:
            overlap = f'circle, overlap {-circle:.2f} m; outline passed by {outline:.2f} m'
            yield f'collided with obstacle {number} ({overlap})'


def _smallest_finite(values):
    finite = values[np.isfinite(values)]
    return float(finite.min()) if finite.size else None


BRAKING_N = -500.0  # the longitudinal force from which a car counts as braking
HARD_BRAKING_N = -1500.0
NOTICEABLE_M = 0.1  # an excursion below this is tracking, not an overshoot
BEND_1PM = 1e-3  # the curvature from which a piece of reference is a bend
REACHED_M = 0.1  # how closely the stop has to be reached
PASSED_M = 1.0  # two laps pass the stop equally closely, but for the sampling of the path


def compute_metrics(drive):
    """Return every metric of a drive by name."""
    drive = drop_nonfinite(drive)
    return compute_metrics_of_series(drive, compute_series(drive))


def compute_metrics_of_series(drive, s):
    """Return every metric of a drive of finite numbers whose Series is known."""
    found = _all_numbers(drive, s)
    return {'verdict': describe_outcome(drive, s, found), **found}


def _all_numbers(drive, s):
    facts, acc = drive.facts, drive.accelerations
    v2o = {str(i): _smallest(gap) for i, gap in s.v2o.items()}
    v2e = {side: _smallest(gap) for side, gap in s.v2e.items()}
    min_v2o = min((gap for gap in v2o.values() if gap is not None), default=None)
    min_v2e = min(v2e.values())
    finish = finish_station(drive, s)
    outline = _smallest(s.outline_gap)
    slip_deg, slip_at = peak_sideslip(s)
    return {
        'completed': is_completed(drive, s, finish),
        'finish_at_m': finish,
        'collided': any(gap is not None and gap < 0.0 for gap in (min_v2o, outline)),
        'collided_by': _collided_by(min_v2o, outline),
        **road_departure(drive, s),
        **control_loss(s),
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
        'braking_s': braking_time(drive, BRAKING_N),
        **counter_steer(drive),
        'peak_lat_acc_mps2': float(np.max(np.abs(acc.ay))) if acc.ay.size else None,
        **friction_shares(drive),
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
        return OUTLINE
    return CIRCLE if min_v2o is not None and min_v2o < 0.0 else None


def finish_station(drive, s):
    """Return the station [m] that completes a drive."""
    from_m = float(s.station[0]) + drive.facts.armed_after
    return stop_station(drive.scene.reference, drive.facts.stop, from_m)


def is_completed(drive, s, finish):
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
    ahead = geometry.project_drive(place, reference[first:], SEARCH_M)
    anywhere = geometry.project_drive(place, reference, SEARCH_M)
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
    ticks, answered = count_periods(
        drive.motion.stamp_ns, drive.ticks.answered_ns, drive.facts.tick_ns
    )
    return {
        'ticks': ticks,
        'deadline_misses': ticks - answered,
        'fallbacks': int(np.count_nonzero(drive.ticks.fallback)),
    }


def count_periods(state_ns, answered_ns, period):
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
