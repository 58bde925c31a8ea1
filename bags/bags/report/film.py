"""The manoeuvre as a film: where every car, plan and obstacle is at each of its frames.

Positions are in the frame map [m], angles in rad, times in seconds since the first state of a run.
The page draws from these numbers; nothing is computed there but a rotation of the outline.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bags.pictures.panels import Run
from bags.report.account import Account
from bags.verdict import judge
from bags.verdict.drive import Scene
from msgs_yaml.stamp import NS_PER_S

FRAME_NS = 20_000_000
STAGE_EVERY = 2  # of the stages of a plan one in this many is drawn


def times(runs: Sequence[Run]) -> np.ndarray:
    """Return the times of the frames [s], from 0 to the end of the longest run."""
    longest = max(int(np.ptp(run.drive.motion.stamp_ns)) for run in runs)
    return np.arange(0, longest + FRAME_NS, FRAME_NS) / NS_PER_S


def car(run: Run, t: np.ndarray) -> dict[str, Any]:
    """Return pose, speed and station of the car in each frame, its outline and circles [m].

    It stays where its run ends.
    """
    motion, series = run.drive.motion, run.series
    columns = {
        'x': motion.x,
        'y': motion.y,
        'yaw': np.unwrap(motion.yaw),
        'speed': series.speed,
        'station': series.station,
    }
    data = {name: np.interp(t, series.t, column) for name, column in columns.items()}
    facts = run.drive.facts
    body = {
        **facts.outline._asdict(),
        'circles': list(facts.circles),
        'radius': facts.vehicle_radius,
        'end': float(series.t[-1]),
    }
    return {**_short({'t': t, **data}), **body}


def plan(run: Run, account: Account) -> dict[str, Any]:
    """Return the predicted horizon of each tick, a row per tick."""
    zero_ns = run.drive.motion.stamp_ns[0]
    length = max((len(one.X) for one in account.predictions), default=0)
    x, y = (
        np.array([_row(getattr(one, axis), length) for one in account.predictions])
        for axis in ('X', 'Y')
    )
    t = np.array([(one.stamp_ns - zero_ns) / NS_PER_S for one in account.predictions])
    return _short({'t': t, 'x': x, 'y': y})


def _row(values, length):
    padded = np.append(values, np.full(length - len(values), np.nan))
    return padded[::STAGE_EVERY]


def obstacles(scene: Scene, start_ns: int, t: np.ndarray) -> dict[str, Any]:
    """Return where each obstacle is in each frame, a row per frame."""
    stamp_ns = start_ns + np.round(t * NS_PER_S).astype(np.int64)
    where = [judge.placed(obstacle, scene, stamp_ns) for obstacle in scene.obstacles]
    x, y = (np.array([one[axis] for one in where]).T for axis in (0, 1))
    return _short({'t': t, 'x': x, 'y': y})


def _short(columns: Mapping[str, np.ndarray]):
    """Seven digits are more than an eye sees, and half the size."""
    return {key: np.asarray(column, dtype=np.float32) for key, column in columns.items()}
