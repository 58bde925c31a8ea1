"""A drive of 100 m of straight road at constant speed: every metric has a closed form."""

import numpy as np

from bags.evaluation import geometry
from bags.evaluation.drive import (
    Accelerations,
    Drive,
    Facts,
    Inputs,
    Motion,
    Obstacle,
    Scene,
    Ticks,
)

MS = 1_000_000
START_NS = 1_000_000_000
SPEED = 20.0  # m/s
FACTS = Facts(
    scenario='straight',
    controller='mpcc',
    outline=geometry.Outline(front=2.4, rear=2.4, width=1.8),
    circles=(0.0,),
    vehicle_radius=1.1,
    safe_obstacle=0.5,
    safe_edge=0.5,
    friction=1.0,
    tick_ns=50 * MS,
    stop=(90.0, 0.0),
    armed_after=20.0,
)


def straight_scene(obstacles=()):
    """Return a road along x, edges 3 m to either side, with obstacle messages at 20 Hz."""
    return Scene(
        reference=np.array([[x, 0.0] for x in np.arange(0.0, 121.0, 1.0)]),
        left=np.array([[0.0, 3.0], [120.0, 3.0]]),
        right=np.array([[0.0, -3.0], [120.0, -3.0]]),
        obstacle_stamp_ns=START_NS + np.arange(0, 101) * 50 * MS,
        obstacles=tuple(obstacles),
    )


def obstacle(number, x, y, vx=0.0, vy=0.0, radius=1.0):
    """Return an obstacle that is at (x, y) first and moves at (vx, vy), for `straight_scene`."""
    t, ones = np.arange(101) * 0.05, np.ones(101)
    return Obstacle(number, x + vx * t, y + vy * t, vx * ones, vy * ones, radius)


def drive_of(*, y=0.0, vy=0.0, yaw=0.0, force=0.0, scene=None, metres=100.0, **facts):
    """Return a Drive along x; the arguments are functions of x or constants."""
    stamp_ns = START_NS + np.arange(0, round(metres / SPEED * 1000) + 1) * MS
    x = (stamp_ns - START_NS) * 1e-9 * SPEED

    def over(value):
        return value(x) if callable(value) else np.full(len(x), float(value))

    # the state at the end of the run gets no command
    tick_ns = stamp_ns[:-1:50]
    return Drive(
        Motion(stamp_ns, x, over(y), over(yaw), np.full(len(x), SPEED), over(vy)),
        Accelerations(stamp_ns, -x / 20.0, 8.0 * np.sin(x / 10.0)),
        Inputs(stamp_ns, 0.1 * np.sin(x / 10.0), over(force)),
        Ticks(tick_ns, *np.repeat([[5.0], [4.0]], len(tick_ns), axis=1), np.zeros(len(tick_ns))),
        straight_scene() if scene is None else scene,
        FACTS._replace(**facts),
    )
