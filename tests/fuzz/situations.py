"""Valid but extreme situations for a controller, over the whole range of the contract.

A car drives along its path at an ordinary speed, except for one to three of ASPECTS with any value
of the contract: it slides, spins, crawls, leaves the road, drives in the wrong direction, or is
between or inside of obstacles, on narrow or bent roads.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from msgs_yaml import encode
from msgs_yaml.types import Obstacle, Obstacles, Reference, RoadEdges, VehicleState

AROUND = ('bends', 'desired speed', 'edges', 'obstacles')  # the car drives as any does
ASPECTS = ('place', 'heading', 'speed', 'sideslip', 'yaw rate', *AROUND)
TICKS = 4  # of a scene, in which the car goes on as it moves
TICK_S = 0.05
LENGTH_M, SPACING_M = 200.0, 5.0  # of the path
MAX_SPEED, MAX_SIDE_SPEED, MAX_YAW_RATE = 110.0, 55.0, 9.0  # of the contract: 120, 60, 10
COUNTS = (0, 1, 2, 4, 5, 12, 150)  # of obstacles; each is two markers at most


class Situation(NamedTuple):
    """The inputs of a controller at one tick."""

    path: Reference
    edges: RoadEdges
    obstacles: Obstacles
    state: VehicleState

    def messages(self, stamp_ns: int) -> dict[str, Any]:
        """Return the message of each topic at an instant, the state last."""
        return {
            '/scenario/reference': encode.reference(self.path._replace(stamp_ns=stamp_ns)),
            '/scenario/road_edges': encode.road_edges(self.edges._replace(stamp_ns=stamp_ns)),
            '/scenario/obstacles': encode.obstacles(self.obstacles._replace(stamp_ns=stamp_ns)),
            '/vehicle/odometry': encode.odometry(self.state._replace(stamp_ns=stamp_ns)),
        }


def generate_situations(
    seed: int, count: int, aspects: Sequence[str] = ASPECTS
) -> Iterator[Situation]:
    """Yield `count` situations, TICKS in a row of the same drive; reproducible by the seed.

    The others of ASPECTS than `aspects` have ordinary values.
    """
    random = np.random.default_rng(seed)
    while count > 0:
        scene = _scene(random, aspects)
        for _ in range(min(TICKS, count)):
            yield scene
            scene = scene._replace(state=_moved(scene.state))
        count -= TICKS


def _scene(random, aspects):
    several = random.choice((1, 2, 3), p=(0.6, 0.3, 0.1))
    wild = set(random.choice(aspects, several, replace=False))
    path = _path(random, 'bends' in wild, 'desired speed' in wild)
    at = int(random.integers(0, len(path.X) if 'place' in wild else len(path.X) // 2))
    state = _state(random, wild, path, at)
    obstacles = _obstacles(random, 'obstacles' in wild, path, at, state)
    return Situation(path, _edges(random, 'edges' in wild, path), obstacles, state)


def _path(random, any_bends, any_speed):
    """Return a path with two curvatures, anywhere."""
    s = np.arange(0.0, LENGTH_M, SPACING_M)
    curvatures = (0.0, 0.02, 0.05, 0.1) if any_bends else (0.0, 0.002, 0.004)
    bends = random.choice(curvatures, 2) * random.choice([-1.0, 1.0], 2)
    curvature = np.where(s < LENGTH_M / 2, *bends)
    psi = random.uniform(-3.0, 3.0) + np.cumsum(curvature) * SPACING_M
    x, y = np.cumsum(np.cos(psi)) * SPACING_M, np.cumsum(np.sin(psi)) * SPACING_M
    middle = psi + curvature * SPACING_M / 2
    corner = random.uniform(-5000.0, 5000.0, 2)
    speed = random.choice((0.5, 3.0, 60.0, 100.0) if any_speed else (15.0, 20.0, 25.0))
    return Reference(0, corner[0] + x, corner[1] + y, middle, s / speed)


def _edges(random, any_edges, path):
    left, right = random.choice((-1.0, 0.6, 1.5, 20.0) if any_edges else (3.0, 6.0), 2)
    across = np.column_stack((-np.sin(path.psi), np.cos(path.psi)))
    middle = np.column_stack((path.X, path.Y))
    return RoadEdges(0, middle + left * across, middle - right * across)


def _state(random, wild, path, at):
    def value(aspect, usual, most):
        return random.uniform(-most, most) if aspect in wild else random.normal(0.0, usual)

    side, turned = value('place', 0.5, 40.0), value('heading', 0.05, np.pi)
    speed = random.uniform(0.0, MAX_SPEED) if 'speed' in wild else random.uniform(10.0, 25.0)
    sideslip = value('sideslip', 0.02, 1.5)
    psi = path.psi[at] + turned
    return VehicleState(
        0,
        path.X[at] - side * np.sin(path.psi[at]),
        path.Y[at] + side * np.cos(path.psi[at]),
        float((psi + np.pi) % (2 * np.pi) - np.pi),
        float(speed * np.cos(sideslip)),
        float(np.clip(speed * np.sin(sideslip), -MAX_SIDE_SPEED, MAX_SIDE_SPEED)),
        float(value('yaw rate', 0.1, MAX_YAW_RATE)),
    )


def _obstacles(random, any_obstacles, path, at, state):
    """Return obstacles: some beside the path, or many ahead, around the car, on it, in overlap."""
    count = int(random.choice(COUNTS if any_obstacles else (0, 1, 2)))
    ahead = np.minimum(at + random.integers(2, 15, count), len(path.X) - 1)
    on_path, car = np.column_stack((path.X[ahead], path.Y[ahead])), (state.X, state.Y)
    beside = random.choice([-4.0, 4.0], (count, 1))
    across = np.column_stack((-np.sin(path.psi[ahead]), np.cos(path.psi[ahead])))
    if not any_obstacles:
        return _placed(on_path + beside * across, np.full(count, 0.5), np.zeros((count, 2)))
    centres = {
        'ahead': on_path + random.normal(0.0, 3.0, (count, 2)),
        'around the car': car + random.normal(0.0, 8.0, (count, 2)),
        'on the car': car + random.normal(0.0, 0.5, (count, 2)),
        'in overlap': on_path[:1].repeat(count, axis=0),
    }
    radii = random.choice([0.005, 0.3, 1.0, 3.0, 50.0], count, p=[0.1, 0.4, 0.3, 0.15, 0.05])
    speeds = random.choice([0.0, 3.0, 90.0], (count, 2), p=[0.7, 0.2, 0.1])
    return _placed(centres[random.choice(list(centres))], radii, speeds)


def _placed(centres, radii, speeds):
    several = enumerate(zip(centres, radii, speeds), 1)
    # every third one is an object of two discs
    return Obstacles(
        0,
        tuple(
            Obstacle(number, *map(float, (*xy, radius, *v)), () if number % 3 else ((2.7, 0.5),))
            for number, (xy, radius, v) in several
        ),
    )


def _moved(x):
    """Return the state a tick later of a car that keeps its velocities."""
    cos, sin = np.cos(x.psi), np.sin(x.psi)
    psi = x.psi + x.r * TICK_S
    return x._replace(
        X=x.X + TICK_S * (x.vx * cos - x.vy * sin),
        Y=x.Y + TICK_S * (x.vx * sin + x.vy * cos),
        psi=float((psi + np.pi) % (2 * np.pi) - np.pi),
    )
