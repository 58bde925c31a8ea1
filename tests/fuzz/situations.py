"""Valid but extreme situations for a controller, over the whole range of the contract.

A car drives along its path at an ordinary speed, except for one to three of ASPECTS with any value
of the contract: it slides, spins, crawls, leaves the road, drives in the wrong direction, or is
between or inside of obstacles, on narrow or bent roads.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from msgs_yaml import encode
from msgs_yaml.types import Obstacle, Obstacles, Reference, RoadEdges, VehicleState

AROUND = ('bends', 'desired speed', 'edges', 'obstacles')  # the car drives as any does
ASPECTS = ('place', 'heading', 'speed', 'sideslip', 'yaw rate', *AROUND)
TICKS = 4  # of a scene, in which the car goes on as it moves
TICK_S = 0.05
S = np.arange(0.0, 200.0, 5.0)  # m, along the path
MAX_SPEED, MAX_SIDE_SPEED, MAX_YAW_RATE = 110.0, 55.0, 9.0  # of the contract: 120, 120, 20
COUNTS = (0, 1, 2, 4, 5, 12, 150)  # of obstacles; each is two markers at most


def scene(seed: int, stamps_ns: Iterable[int], aspects: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yield the messages of the ticks of a scene by topic, the state last.

    The others of ASPECTS than `aspects` have ordinary values.
    """
    random = np.random.default_rng(seed)
    several = random.choice((1, 2, 3), p=(0.6, 0.3, 0.1))
    wild = set(random.choice(aspects, several, replace=False))
    # two curvatures, anywhere
    curvatures = (0.0, 0.02, 0.05, 0.1) if 'bends' in wild else (0.0, 0.002, 0.004)
    curvature = np.where(S < 100.0, *random.choice(curvatures, 2) * random.choice([-1, 1], 2))
    psi = random.uniform(-3.0, 3.0) + np.cumsum(curvature) * 5.0
    line = np.column_stack((np.cos(psi), np.sin(psi)))
    line = random.uniform(-5000.0, 5000.0, 2) + np.cumsum(line, axis=0) * 5.0
    psi += curvature * 2.5
    across = np.column_stack((-np.sin(psi), np.cos(psi)))
    desired = (0.5, 3.0, 60.0, 100.0) if 'desired speed' in wild else (15.0, 20.0, 25.0)
    path = Reference(0, *line.T, psi, S / random.choice(desired))
    widths = (-1.0, 0.6, 1.5, 20.0) if 'edges' in wild else (3.0, 6.0)
    left, right = random.choice(widths, 2)
    edges = RoadEdges(0, line + left * across, line - right * across)
    at = int(random.integers(0, len(S) if 'place' in wild else len(S) // 2))
    x = _state(random, wild, line[at], across[at], psi[at])
    ahead = np.minimum(at + random.integers(2, 15, random.choice(COUNTS)), len(S) - 1)
    if 'obstacles' in wild:
        obstacles = _crowd(random, line[ahead], (x.X, x.Y))
    else:
        beside = line[ahead[:2]] + random.choice([-4.0, 4.0]) * across[ahead[:2]]
        obstacles = tuple(Obstacle(k, *map(float, o), 0.5, 0.0, 0.0) for k, o in enumerate(beside))
    for stamp_ns in stamps_ns:
        yield {
            '/scenario/reference': encode.reference(path._replace(stamp_ns=stamp_ns)),
            '/scenario/road_edges': encode.road_edges(edges._replace(stamp_ns=stamp_ns)),
            '/scenario/obstacles': encode.obstacles(Obstacles(stamp_ns, obstacles)),
            '/vehicle/odometry': encode.odometry(x._replace(stamp_ns=stamp_ns)),
        }
        moved = complex(x.X, x.Y) + TICK_S * complex(x.vx, x.vy) * np.exp(1j * x.psi)
        x = x._replace(X=moved.real, Y=moved.imag, psi=_wrapped(x.psi + TICK_S * x.r))


def _state(random, wild, place, across, psi):
    def value(aspect, usual, most):
        return random.uniform(-most, most) if aspect in wild else random.normal(0.0, usual)

    X, Y = place + value('place', 0.5, 40.0) * across
    speed = random.uniform(0.0, MAX_SPEED) if 'speed' in wild else random.uniform(10.0, 25.0)
    velocity = speed * np.exp(1j * value('sideslip', 0.02, 1.5))
    vy = np.clip(velocity.imag, -MAX_SIDE_SPEED, MAX_SIDE_SPEED)
    psi = _wrapped(psi + value('heading', 0.05, np.pi))
    r = value('yaw rate', 0.1, MAX_YAW_RATE)
    return VehicleState(0, *map(float, (X, Y, psi, velocity.real, vy, r)))


def _crowd(random, ahead, car):
    """Return obstacles ahead, around the car, on it, or in overlap, some of two discs."""
    shape = len(ahead), 2
    places = (
        ahead + random.normal(0.0, 3.0, shape),
        car + random.normal(0.0, 8.0, shape),
        car + random.normal(0.0, 0.5, shape),
        ahead[:1].repeat(len(ahead), axis=0),
    )[random.integers(4)]
    radii = random.choice([0.005, 0.3, 1.0, 3.0, 50.0], len(ahead), p=[0.1, 0.4, 0.3, 0.15, 0.05])
    speeds = random.choice([0.0, 3.0, 90.0], shape, p=[0.7, 0.2, 0.1])
    rows = enumerate(np.column_stack((places, radii, speeds)).tolist())
    return tuple(Obstacle(k, *row, () if k % 3 else ((2.7, 0.5),)) for k, row in rows)


def _wrapped(angle):
    return float((angle + np.pi) % (2 * np.pi) - np.pi)
