"""Coarse paths past the obstacles of an emergency, on every side that has room.

A speed profile says where the car meets each obstacle; what blocks the road there leaves free
intervals beside the course; a sequence of intervals is a path. The paths with the least lateral
change for their length come first.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from experiments.survivable.emergency import TICK_S, Emergency
from experiments.survivable.road_coordinates import Path
from msgs_yaml.conversions import NS_PER_S

PATHS = 8  # of one speed profile, at most
CLEAR_M = 0.45  # from the outline to an obstacle, where there is room
REACH_M = 3.0  # ahead of and behind an obstacle the path keeps to its interval
TOGETHER_M = 6.0  # obstacles met within this distance leave common intervals
BEHIND_M = 10.0  # the path begins so far behind the car
BRAKING = (0.0, 0.35, 0.9)  # of the road's friction, of a speed profile
LEAST_MPS = 2.0


class Approach(NamedTuple):
    """A path and the speed along it."""

    path: Path
    speed: np.ndarray  # m/s at the samples of the path
    offsets: np.ndarray  # m, of the samples from the course
    braking: float  # m/s^2, of the profile


class Meeting(NamedTuple):
    """Where obstacles block the road while the car passes: offsets from the course."""

    begin: float  # m, station
    end: float
    blocked: tuple[tuple[float, float], ...]  # m, (right, left) of each disc of them


def approaches(emergency: Emergency) -> list[Approach]:
    """Return the approaches of all speed profiles; those without braking first."""
    grip = emergency.setup.friction * emergency.setup.plant.car.body.gravity_mps2
    return [approach for share in BRAKING for approach in _approaches_at(emergency, share * grip)]


def _approaches_at(emergency, braking):
    course, now = emergency.course, emergency.car.state
    s0, n0 = (float(value) for value in course.project(now.X, now.Y))
    v0 = max(float(np.hypot(now.vx, now.vy)), LEAST_MPS)
    t = TICK_S * np.arange(emergency.most_ticks)
    v = np.maximum(v0 - braking * t, LEAST_MPS)
    s = s0 + np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2 * TICK_S)])
    turned = now.psi - float(np.interp(s0, course.s, course.psi))
    slope = np.tan(np.clip(turned - np.round(turned / (2 * np.pi)) * 2 * np.pi, -1, 1))
    width = emergency.setup.plant.car.outline.width_m
    meetings = _meetings(emergency, s)
    stations = course.s[course.s >= max(0.0, s0 - BEHIND_M)]
    speed = np.interp(stations, s, v)
    for offsets in _choose(course, meetings, s0, n0, width):
        n = _line(meetings, offsets, s0, n0, slope, v0, stations)
        yield Approach(course.shifted(stations, n), speed, n, braking)


def _meetings(emergency, s) -> list[Meeting]:
    """Return where the car at stations s (ticks,) meets obstacles on the road, in their order."""
    stamps = emergency.start_ns + round(TICK_S * NS_PER_S) * np.arange(len(s))
    met = {}
    for k, stamp in enumerate(stamps):
        for key, o in emergency.discs_at(int(stamp)).items():
            s_o, n_o = (float(value) for value in emergency.course.project(o.X, o.Y))
            if abs(s_o - s[k]) < o.r_obs + REACH_M:
                met.setdefault(key, []).append((float(s[k]), s_o, n_o - o.r_obs, n_o + o.r_obs))
    blocks = []
    for rows in met.values():
        car, own, right, left = np.array(rows).T
        # a disc that stands is as long as it is; one that moves, where it was met
        ends = min(car.min(), own.min()), max(car.max(), own.max())
        blocks.append((*ends, right.min(), left.max()))
    meetings: list[Meeting] = []
    for begin, end, right, left in sorted(blocks):
        road_right, road_left = emergency.course.room((begin + end) / 2)
        if left < road_right or right > road_left:
            continue
        if not meetings or begin - meetings[-1].begin > TOGETHER_M:
            meetings.append(Meeting(begin, end, ()))
        last = meetings.pop()
        blocked = (*last.blocked, (right, left))
        meetings.append(last._replace(end=max(last.end, end), blocked=blocked))
    return meetings


def _intervals(meeting, course, width):
    """Return the free intervals (right, left) that are wide enough for the car."""
    right, left = (float(value) for value in course.room((meeting.begin + meeting.end) / 2))
    free, edge = [], right - 0.3
    for low, high in sorted(meeting.blocked):
        free.append((edge, low))
        edge = max(edge, high)
    free.append((edge, left + 0.3))
    return [(low, high) for low, high in free if high - low > width + 0.1]


def _choose(course, meetings, s0, n0, width):
    """Return the best sequences of offsets, one per meeting, by lateral change over length."""
    sequences = [(0.0, ())]
    last_s = s0
    for meeting in meetings:
        longer = []
        run = max(meeting.begin - last_s, 1.0)
        for cost, offsets in sequences:
            before = offsets[-1] if offsets else n0
            for low, high in _intervals(meeting, course, width):
                clear = min(CLEAR_M, (high - low - width) / 2)
                for wish in {0.0, before}:
                    n = float(np.clip(wish, low + width / 2 + clear, high - width / 2 - clear))
                    longer.append((cost + abs(n - before) / run**2 + 1e-5 * abs(n), (*offsets, n)))
        unique = {tuple(np.round(offsets, 2)): (cost, offsets) for cost, offsets in longer}
        sequences = sorted(unique.values())[:PATHS]
        last_s = meeting.end
    # with the path that goes straight on, for what braking alone can do
    straight = tuple(0.0 for _ in meetings)
    return [offsets for _, offsets in sequences] or [straight]


def _line(meetings, offsets, s0, n0, slope, v0, stations):
    """Return the offsets (m,) at stations: a monotone cubic through the meetings."""
    knots = [(s0 - BEHIND_M, n0 - slope * BEHIND_M), (s0, n0)]
    for meeting, n in zip(meetings, offsets):
        for s in (meeting.begin - REACH_M / 2, meeting.end + REACH_M / 2):
            if s > knots[-1][0] + 1.0:
                knots.append((s, n))
            elif len(knots) > 2:
                knots[-1] = (knots[-1][0], n)
            else:
                knots.append((knots[-1][0] + 1.0, n))
    back = max(20.0, (1.5 if meetings else 1.0) * v0)
    knots.append((knots[-1][0] + back, 0.0))
    knots.append((max(knots[-1][0] + 10.0, float(stations[-1]) + 10.0), 0.0))
    s, n = np.array(knots).T
    return PchipInterpolator(s, n)(np.clip(stations, s[0], s[-1]))
