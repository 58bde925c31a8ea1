"""How a plan passes obstacles: its gaps to them, its sides of them, its speed at a contact.

SI units. Sides are those of the car: LEFT passes left of the obstacle. Two plans that pass an
obstacle that may move on different sides cannot be deformed into each other: they are of different
homotopy classes (Bhattacharya, Likhachev & Kumar 2012), and a solver finds only that of its guess.
"""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from mpcc_controller.model.single_track import State
from mpcc_controller.parameters import ControllerParams
from mpcc_controller.path import reference_path
from mpcc_controller.problem import stage_parameters
from mpcc_controller.problem.obstacle_motion import position, velocity
from mpcc_controller.problem.stage_parameters import Scene
from msgs_yaml.types import Obstacle

LEFT, RIGHT, BEHIND = 1, -1, 0  # BEHIND: not passed within the horizon
OVERLAP_M = 0.1
LEAST_CONTACT_MPS = 1e-3  # of a contact: 0 stands for none
WORDS = {LEFT: 'left', RIGHT: 'right', BEHIND: 'behind'}

Sides = dict[int, int]  # by the id of the obstacle


def least_gaps(X: np.ndarray, scene: Scene, params: ControllerParams) -> np.ndarray:
    """Return the least V2O [m] to each obstacle (n,) along planned states (N + 1, 9)."""
    return np.min(_gaps(X, scene, params), axis=-1)


def contact_speed(X: np.ndarray, scene: Scene, params: ControllerParams) -> float:
    """Return the relative speed [m/s] of the first contact of planned states (N + 1, 9).

    0 without one. Circles that overlap by less than OVERLAP_M may be outlines that do not touch.
    """
    if not scene.obstacles.items:
        return 0.0
    touches = _gaps(X, scene, params) < -OVERLAP_M
    if not np.any(touches):
        return 0.0
    stage = int(np.argmax(np.any(touches, axis=0)))
    x, obstacle = State(*X[stage]), scene.obstacles.items[int(np.argmax(touches[:, stage]))]
    vX, vY = velocity(obstacle, stage * params.model.step_s)
    vX = x.vx * math.cos(x.psi) - x.vy * math.sin(x.psi) - vX
    vY = x.vx * math.sin(x.psi) + x.vy * math.cos(x.psi) - vY
    return max(math.hypot(vX, vY), LEAST_CONTACT_MPS)


def passed_sides(
    X: np.ndarray, scene: Scene, obstacles: Sequence[Obstacle], params: ControllerParams
) -> Sides:
    """Return the side on which planned states (N + 1, 9) pass each obstacle, by its id.

    It counts where the car is beside the obstacle along the path, both at the same time, and at the
    end of the horizon no more behind its centre.
    """
    if not obstacles:
        return {}
    x = State(*X.T)
    arcs, _ = reference_path.arcs_at(scene.path, x.theta)
    oX, oY = positions(tuple(obstacles), len(X), params.model.step_s)
    cos_psi, sin_psi = np.cos(arcs.psi), np.sin(arcs.psi)
    ahead = cos_psi * (oX - x.X) + sin_psi * (oY - x.Y)
    aside = cos_psi * (oY - x.Y) - sin_psi * (oX - x.X)
    stages = np.argmin(np.abs(ahead), axis=1)
    sides = {}
    for row, (obstacle, stage) in enumerate(zip(obstacles, stages)):
        gap = ahead[row, stage]
        is_beside = abs(gap) < obstacle.r_obs + params.body.circle_radius_m
        # a plan that waits behind it and comes beside it at last has not passed it
        is_beside &= stage < len(X) - 1 or gap <= 0
        side = LEFT if aside[row, stage] < 0 else RIGHT
        sides[obstacle.id] = side if is_beside else BEHIND
    return sides


def name_of(sides: Sides) -> str:
    """Return the sides as words: `left of 1, right of 4`."""
    return ', '.join(f'{WORDS[side]} of {key}' for key, side in sides.items())


def are_opposed(sides: Sides, other: Sides) -> bool:
    """Return whether some obstacle is passed on the left by one and on the right by the other."""
    return any(sides.get(key, BEHIND) * side < 0 for key, side in other.items())


def is_same_way(sides: Sides, other: Sides) -> bool:
    """Return whether every obstacle is passed on the same side, or by neither."""
    keys = sides.keys() | other.keys()
    return all(sides.get(key, BEHIND) == other.get(key, BEHIND) for key in keys)


def _gaps(X, scene, params) -> np.ndarray:
    """Return V2O [m] to each obstacle at each stage (n, N + 1)."""
    x = State(*X.T)
    oX, oY = positions(scene.obstacles.items, len(X), params.model.step_s)
    cos_psi, sin_psi = np.cos(x.psi), np.sin(x.psi)
    square = np.inf
    for offset in params.body.circle_offsets_m:
        dX, dY = oX - x.X - offset * cos_psi, oY - x.Y - offset * sin_psi
        square = np.minimum(square, dX**2 + dY**2)
    t = params.model.step_s * np.arange(len(X))
    radii = [stage_parameters.grown_radius(params, o, t) for o in scene.obstacles.items]
    grown = np.array([np.broadcast_to(radius, t.shape) for radius in radii])
    return np.sqrt(square) - grown - params.body.circle_radius_m


@lru_cache(maxsize=16)
def positions(obstacles: tuple[Obstacle, ...], count: int, dt: float):
    """Return X and Y (n, count) [m] of obstacles at the stages, not to be changed.

    A tick asks for those of the same obstacles ten times and more.
    """
    t = dt * np.arange(count)
    X, Y = np.array([position(o, t) for o in obstacles]).transpose(1, 0, 2)
    X.flags.writeable = Y.flags.writeable = False
    return X, Y
