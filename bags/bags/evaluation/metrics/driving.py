"""How a car was driven: tracking, sideslip, braking, steering, grip; and how its controller did."""

import numpy as np

from bags.evaluation import geometry
from bags.evaluation.drive import SEARCH_M, obstacle_position
from bags.evaluation.metrics.registry import EvaluatedDrive, metric

GRAVITY = 9.81  # m/s^2
BRAKING_N = -500.0  # the longitudinal force from which a car counts as braking
HARD_BRAKING_N = -1500.0
NOTICEABLE_M = 0.1  # an excursion below this is tracking, not an overshoot
BEND_1PM = 1e-3  # the curvature from which a piece of reference is a bend
JERK_WINDOW_S = 0.1
HELD_NS = 100_000_000  # how long a car is at a limit to have reached it
SAMPLE_NS = 10_000_000  # between even samples of forces and angles
NS = 1e-9  # s
# below these a steering angle and a turn have no side: 1 deg at the road wheel, 3 deg/s
STEERED_RAD = np.radians(1.0)
TURNING_RADPS = np.radians(3.0)
STATISTICS = ('mean', 'p50', 'p99', 'max')
STATISTIC_LABELS = {'p50': 'median', 'p99': '99 %'}
PAPER_SOLVE_MS = {'mean': 15.6, 'max': 18.6}  # FORCESPro on a dSPACE DS6001, 2.8 GHz


@metric('overshoots at x', 'm', 2)
def overshoots(run):
    """Where the vehicle ran wide: [{x_m, amount_m}] in driving order.

    The reference is a sequence of bends; the outer side of a bend is the one it turns away from,
    and a bend rules until the next one begins. An excursion is the stretch of the drive between
    two crossings of the reference. It is an overshoot when it lies on the outer side of the bend
    that rules where it begins or where it is widest, and is wider than 0.1 m: so is entering a
    lane change late, and swinging beyond the line at its end, but not cutting a corner.
    """
    contouring, station = run.series.contouring, run.series.station
    starts, turns = _bends(run.drive.scene.reference)
    side = np.sign(contouring)
    crossings = np.flatnonzero(np.diff(side) != 0.0) + 1
    result = []
    for stretch in np.split(np.arange(len(side)), crossings):
        peak = stretch[np.argmax(np.abs(contouring[stretch]))]
        amount = float(np.abs(contouring[peak]))
        ruling = np.searchsorted(starts, station[[stretch[0], peak]], side='right') - 1
        wide = [k >= 0 and side[peak] == -turns[k] for k in ruling]
        if amount > NOTICEABLE_M and any(wide):
            result.append({'x_m': float(run.drive.motion.x[peak]), 'amount_m': amount})
    return result


@metric(unit='m')
def peak_overshoot_m(run):
    """Largest amount of the overshoots, 0 without any."""
    return max((overshoot['amount_m'] for overshoot in run.value(overshoots)), default=0.0)


@metric('peak sideslip angle', 'deg', 1, until_spin=True)
def peak_sideslip_deg(run):
    """Largest sideslip angle at the centre of gravity; None of a car that hardly moves.

    The table shows none of a car that spun, since backwards it reaches any angle.
    """
    peak = run.value(_peak_sideslip_row)
    return None if peak is None else float(np.degrees(np.abs(run.series.sideslip[peak])))


@metric('  at station', 'm', 1, until_spin=True)
def peak_sideslip_at_m(run):
    """Station of the largest sideslip angle."""
    peak = run.value(_peak_sideslip_row)
    return None if peak is None else float(run.series.station[peak])


@metric('min speed', 'm/s', 1)
def min_speed_mps(run):
    """Smallest speed over ground."""
    return float(np.min(run.series.speed))


@metric('braking from station', 'm', 1)
def brake_onset_at_m(run):
    """Station at which the actuated longitudinal force first falls to -500 N."""
    return brake_onset(run, BRAKING_N)


@metric('peak deceleration', 'm/s²', 1)
def peak_brake_mps2(run):
    """Largest measured deceleration."""
    ax = run.drive.accelerations.ax
    return max(0.0, -float(np.min(ax))) if ax.size else None


@metric(unit='m')
def brake_onset_hard_at_m(run):
    """Station at which the actuated longitudinal force first falls to -1500 N."""
    return brake_onset(run, HARD_BRAKING_N)


@metric(unit='m')
def planned_brake_onset_at_m(run):
    """Station at which the car begins to brake (-500 N) by plan, before the last obstacle.

    The actuated force stays there for 0.1 s, every tick of which follows a plan that converged, and
    the station is before that of the last obstacle along the reference. None otherwise: braking
    without a plan, and into or beyond an obstacle, is no onset.
    """
    return planned_brake_onset(run, BRAKING_N)


@metric(unit='m')
def planned_brake_onset_hard_at_m(run):
    """Station at which the car begins to brake hard (-1500 N) by plan, before the last obstacle."""
    return planned_brake_onset(run, HARD_BRAKING_N)


@metric(unit='s')
def braking_s(run):
    """How long the actuated longitudinal force was at or below -500 N."""
    inputs = run.drive.inputs
    if not inputs.stamp_ns.size:
        return None
    force = np.interp(_even_stamps(inputs.stamp_ns), inputs.stamp_ns, inputs.force)
    return float(np.count_nonzero(force <= BRAKING_N) * SAMPLE_NS * NS)


@metric(unit='s')
def counter_steer_s(run):
    """How long the wheels were steered against the turn of the car.

    Steering angle and yaw rate have opposite signs, both beyond what is noise. Every change of
    direction has a little of it, because the steering leads; a sliding rear axle has much.
    """
    against = run.value(_counter_steering)
    return None if against is None else float(np.count_nonzero(against) * SAMPLE_NS * NS)


@metric(unit='deg')
def peak_counter_steer_deg(run):
    """Largest angle by which the wheels were steered against the turn of the car."""
    against = run.value(_counter_steering)
    return None if against is None else float(np.degrees(np.max(against)))


@metric('peak lateral acceleration', 'm/s²', 1)
def peak_lat_acc_mps2(run):
    """Largest measured lateral acceleration."""
    ay = run.drive.accelerations.ay
    return float(np.max(np.abs(ay))) if ay.size else None


@metric(unit='m/s²')
def held_lat_acc_mps2(run):
    """Largest lateral acceleration that was held to one side for 0.1 s."""
    stamp_ns, ay = run.drive.accelerations.stamp_ns, run.drive.accelerations.ay
    if not ay.size or stamp_ns[-1] - stamp_ns[0] < HELD_NS:
        return None
    even = np.interp(_even_stamps(stamp_ns), stamp_ns, ay)
    windows = np.lib.stride_tricks.sliding_window_view(even, HELD_NS // SAMPLE_NS + 1)
    return float(max(0.0, np.max(windows.min(axis=1)), -np.min(windows.max(axis=1))))


@metric(unit='-')
def lateral_limit_use_plant(run):
    """Lateral acceleration held for 0.1 s as a share of what the plant holds in a steady turn.

    The plant's own limit on this road, by quasi-steady circular driving; None where the run does
    not say it.
    """
    held, limit = run.value(held_lat_acc_mps2), run.drive.facts.lateral_limit
    return None if held is None or not limit else held / limit


@metric(unit='m/s³')
def rms_lat_jerk_mps3(run):
    """Root mean square of the lateral jerk: the slope of the measured acceleration over 0.1 s.

    Times at which the acceleration is not finite do not count; None without any other.
    """
    stamp_ns, ay = run.drive.accelerations.stamp_ns, run.drive.accelerations.ay
    t = (stamp_ns - stamp_ns[:1]) * NS
    if not ay.size or t[-1] - t[0] < JERK_WINDOW_S:
        return None
    inner = t[(t >= JERK_WINDOW_S / 2) & (t <= t[-1] - JERK_WINDOW_S / 2)]
    ahead, behind = (np.interp(inner + side * JERK_WINDOW_S / 2, t, ay) for side in (1, -1))
    jerk = (ahead - behind)[np.isfinite(ahead - behind)] / JERK_WINDOW_S
    return float(np.sqrt(np.mean(jerk**2))) if jerk.size else None


@metric(unit='-')
def peak_lat_acc_share(run):
    """Largest lateral acceleration over µg, of the tyres that the controller believes in."""
    return _friction_share(run, run.value(peak_lat_acc_mps2))


@metric(unit='-')
def peak_brake_share(run):
    """Largest deceleration over µg, of the tyres that the controller believes in."""
    return _friction_share(run, run.value(peak_brake_mps2))


@metric('rms contouring error', 'm', 2)
def rms_contouring_m(run):
    """Root mean square of the lateral distance from the reference."""
    return float(np.sqrt(np.mean(run.series.contouring**2)))


@metric('solve time, {}', 'ms', 1, labels=STATISTIC_LABELS, paper=PAPER_SOLVE_MS)
def solve_ms(run):
    """Wall time of the solver per tick: mean, median, 99th percentile, maximum."""
    return time_statistics(run.drive.ticks.solve_ms)


@metric(unit='ms')
def solve_cpu_ms(run):
    """Processor time of the solver per tick likewise."""
    return time_statistics(run.drive.ticks.solve_cpu_ms)


@metric('ticks')
def ticks(run):
    """Return the number of controller periods, from the first answer to the last state."""
    return run.value(_tick_counts)[0]


@metric('deadline misses')
def deadline_misses(run):
    """Return the number of controller periods of which no command carries a stamp."""
    count, answered = run.value(_tick_counts)
    return count - answered


@metric('fallbacks')
def fallbacks(run):
    """Return the number of ticks at which the controller followed no fresh plan."""
    return int(np.count_nonzero(run.drive.ticks.fallback))


@metric()
def stopped_early(run):
    """Return the number of ticks whose plan was followed although its solve stopped early."""
    ticks = run.drive.ticks
    if len(ticks.converged) != len(ticks.fallback):  # not known
        return 0
    return int(np.count_nonzero(~np.asarray(ticks.fallback, bool) & ~ticks.converged))


def _peak_sideslip_row(run):
    sideslip = np.abs(run.series.sideslip)
    return None if np.all(np.isnan(sideslip)) else int(np.nanargmax(sideslip))


def brake_onset(run: EvaluatedDrive, force_n: float) -> float | None:
    """Return the station [m] at which the actuated force first falls to `force_n`, or None."""
    inputs = run.drive.inputs
    below = np.flatnonzero(inputs.force <= force_n)
    if not below.size:
        return None
    stamp_ns = inputs.stamp_ns[below[0]]
    return float(np.interp(stamp_ns, run.drive.motion.stamp_ns, run.series.station))


def planned_brake_onset(run: EvaluatedDrive, force_n: float) -> float | None:
    """Return the station [m] of `planned_brake_onset_at_m` for a force, or None."""
    drive, station = run.drive, run.series.station
    inputs, ticks = drive.inputs, drive.ticks
    if not inputs.stamp_ns.size or not ticks.converged.size:
        return None
    stamps = _even_stamps(inputs.stamp_ns)
    force = np.interp(stamps, inputs.stamp_ns, inputs.force)
    tick = np.searchsorted(ticks.stamp_ns, stamps, side='right') - 1
    planned = (tick >= 0) & ticks.converged[np.maximum(tick, 0)]
    at = np.interp(stamps, drive.motion.stamp_ns, station)
    braking = (force <= force_n) & planned & (at < run.value(_last_obstacle_at))
    count = HELD_NS // SAMPLE_NS + 1
    if len(braking) < count:
        return None
    held = np.lib.stride_tricks.sliding_window_view(braking, count).all(axis=1)
    return float(at[np.argmax(held)]) if held.any() else None


def _last_obstacle_at(run):
    """Return the station [m] at which the car passes the last obstacle, infinity without any.

    That of the obstacle where it is closest to the car.
    """
    motion, scene = run.drive.motion, run.drive.scene
    stations = []
    for obstacle in scene.obstacles:
        x, y = obstacle_position(obstacle, scene, motion.stamp_ns)
        away = np.hypot(motion.x - x, motion.y - y)
        if np.any(np.isfinite(away)):
            row = np.nanargmin(away)
            point = np.array([[x[row], y[row]]])
            foot = geometry.project_drive(point, scene.reference, SEARCH_M)
            stations.append(float(foot.distance[0]))
    return max(stations, default=np.inf)


def _counter_steering(run):
    """Return |steering angle| (n,) [rad] while it is against the turn, else 0; None if unknown."""
    motion, inputs = run.drive.motion, run.drive.inputs
    if not inputs.stamp_ns.size:
        return None
    stamps = _even_stamps(motion.stamp_ns)
    steer = np.interp(stamps, inputs.stamp_ns, inputs.steer)
    yaw = np.interp(stamps, motion.stamp_ns, np.unwrap(motion.yaw))
    # two samples have one difference; a drive of one has none
    turn = np.gradient(yaw, SAMPLE_NS * NS) if len(yaw) > 1 else np.zeros(len(yaw))
    against = (steer * turn < 0) & (np.abs(turn) > TURNING_RADPS) & (np.abs(steer) > STEERED_RAD)
    return np.where(against, np.abs(steer), 0.0)


def _even_stamps(stamp_ns):
    return np.arange(stamp_ns.min(), stamp_ns.max() + 1, SAMPLE_NS)


def _friction_share(run, acceleration):
    if acceleration is None:
        return None
    return acceleration / (run.drive.facts.friction * GRAVITY)


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


def time_statistics(times_ms: np.ndarray) -> dict[str, float | None]:
    """Return mean, median, 99th percentile and maximum [ms]; None each without a time."""
    known = times_ms[np.isfinite(times_ms)]
    if not known.size:
        return dict.fromkeys(STATISTICS)
    values = (known.mean(), *np.percentile(known, [50, 99]), known.max())
    return {name: float(value) for name, value in zip(STATISTICS, values)}


def _tick_counts(run):
    drive = run.drive
    return count_periods(drive.motion.stamp_ns, drive.ticks.answered_ns, drive.facts.tick_ns)


def count_periods(state_ns: np.ndarray, answered_ns: np.ndarray, period_ns: int) -> tuple[int, int]:
    """Return how many controller periods a drive has, and how many of them were answered.

    They count from the first answer: the car is held at its start until then. The period of the
    last state is left out: its answer may come after the end. Without any answer every period
    between the first state and the last one counts.
    """
    first, last = (-(-int(stamp) // period_ns) for stamp in (state_ns.min(), state_ns.max()))
    answered = np.unique(answered_ns // period_ns)
    answered = answered[(answered >= first) & (answered < last)]
    first = int(answered[0]) if answered.size else first
    return last - first, len(answered)
