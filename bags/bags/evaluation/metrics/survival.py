"""Whether a car came through: the judge of emergencies, where braking to a stop counts, too.

Survived: the true outline touched no obstacle, no wheel was further off the road than a shoulder
takes, the car never slid beyond recovery, and it crossed the finish line, stands, or follows what
drives ahead of it.
"""

import numpy as np

from bags.evaluation.drive import latest_message, obstacle_position
from bags.evaluation.metrics.outcome import (
    SLIDING_DEG,
    STANDING_MPS,
    edge_margins,
    finish_at_m,
)
from bags.evaluation.metrics.registry import metric

SHOULDER_M = 0.5  # how far a wheel may leave the road
SLIDING_FROM_MPS = 5.0  # below it a car that slides comes to rest within its length
# a car follows what is so close ahead of its nose, and is no more faster than that
FOLLOWING_M, FOLLOWING_S = 3.0, 2.0  # m, and s of driving
CLOSING_MPS = 1.0


@metric()
def finished(run):
    """Whether the centre of gravity passed the finish line, on the road or beside it."""
    finish, station = run.value(finish_at_m), run.series.station
    return bool(station[0] < finish <= station.max())


@metric()
def stopped(run):
    """Whether the car stands at the end: slower than 0.5 m/s."""
    return bool(run.series.speed[-1] < STANDING_MPS)


@metric()
def following(run):
    """Whether at the end the car follows an obstacle: moving, close ahead, hardly slower than it.

    Close is up to 3 m and 2 s of driving from its nose, on the straight strip that its width
    sweeps; the gap closes by at most 1 m/s.
    """
    motion, scene, outline = run.drive.motion, run.drive.scene, run.drive.facts.outline
    stamp_ns = motion.stamp_ns[-1:]
    cos, sin = np.cos(motion.yaw[-1]), np.sin(motion.yaw[-1])
    message = latest_message(scene, stamp_ns)[0]
    for obstacle in scene.obstacles:
        x, y = (value[0] for value in obstacle_position(obstacle, scene, stamp_ns))
        dx, dy = x - motion.x[-1], y - motion.y[-1]
        gap = dx * cos + dy * sin - obstacle.radius - outline.front
        aside = abs(dy * cos - dx * sin) - obstacle.radius - outline.width / 2
        speed = obstacle.vx[message] * cos + obstacle.vy[message] * sin
        is_ahead = 0.0 < gap < FOLLOWING_M + FOLLOWING_S * motion.vx[-1] and aside < 0.0
        if is_ahead and speed >= STANDING_MPS and motion.vx[-1] - speed <= CLOSING_MPS:
            return True
    return False


@metric(unit='m')
def wheel_off_road_m(run):
    """How far the farthest wheel ever was beyond an edge; 0 on the road, None if unknown.

    Of the middle of its contact patch, every 10 ms; unknown where the track widths are.
    """
    if not run.drive.facts.wheels:
        return None
    _, beyond = run.value(_wheels_beyond_edge)
    return max(0.0, float(beyond.max()))


@metric()
def survived(run):
    """Whether nothing touched, no wheel was over 0.5 m off the road, no slide, and it ended well.

    No slide: the sideslip angle stayed below 30 deg above 5 m/s. Ended well: finished, stopped, or
    following. None where the position of the wheels is unknown.
    """
    return None if not run.drive.facts.wheels else run.value(lost_by) is None


@metric()
def lost_by(run):
    """Why the car did not survive: what happened first; None if it did, or if unknown.

    `touched obstacle <id>`, `left the road`, `slid`, or `neither finished nor stopped` (nor does it
    follow another).
    """
    if not run.drive.facts.wheels:
        return None
    series = run.series
    events = [
        (_first_time(series.t, gap < 0.0), f'touched obstacle {number}')
        for number, gap in series.outline_gaps.items()
    ]
    rows, beyond = run.value(_wheels_beyond_edge)
    events.append((_first_time(series.t[rows], beyond > SHOULDER_M), 'left the road'))
    slides = np.degrees(np.abs(series.sideslip)) > SLIDING_DEG
    events.append((_first_time(series.t, slides & (series.speed > SLIDING_FROM_MPS)), 'slid'))
    first, cause = min(events)
    if np.isfinite(first):
        return cause
    ended_well = run.value(finished) or run.value(stopped) or run.value(following)
    return None if ended_well else 'neither finished nor stopped'


def _first_time(t, happens):
    """Return the first time [s] at which something happens, infinity for never."""
    return float(t[np.argmax(happens)]) if np.any(happens) else np.inf


def _wheels_beyond_edge(run):
    """Return indices (n,) of odometry messages and how far [m] a wheel is beyond an edge then.

    That of the farthest wheel; negative on the road, minus infinity far inside of it.
    """
    rows, margins = edge_margins(run, np.array(run.drive.facts.wheels))
    return rows, -np.min([*margins.values()], axis=0)
