"""One track per obstacle, from message to message: its motion, and whether it exists. SI units.

The motion is that of a Kalman filter of constant acceleration whose jerk is white noise; position
and velocity are measured (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
Navigation, 2001, section 6.2.3). X and Y are independent and alike: they share a covariance.

Where a measurement is out of the gate the id has gone to another object: a new track begins. That
an obstacle exists becomes the more certain, the oftener it is seen, and less with every message
without it (Musicki, Evans, Stankovic, "Integrated probabilistic data association", IEEE Trans.
Automatic Control 39(6), 1994): a track without a measurement is kept while it is more likely than
not that the obstacle was missed. So a ghost that is seen once is not remembered.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mpcc_controller.parameters import Tracker
from msgs_yaml.types import Obstacle

START_MPS2 = 3.0  # m/s^2, standard deviation of the acceleration of a new track, per axis
GATE = 60.0  # square of standard deviations, of 4 measurements: once in 3e11 beyond it
GHOST_AGAIN = 0.1  # probability that what does not exist is seen again
SUREST = math.log(1e4)  # of the odds that an obstacle exists
LONGEST_S = 1.0  # between two messages, else all are new


class Track(NamedTuple):
    """The motion of the first disc of an obstacle, and how sure it is."""

    mean: np.ndarray  # (3, 2) m, m/s, m/s^2: position, velocity, acceleration in the map
    covariance: np.ndarray  # (3, 3) of these, of either axis
    odds: float  # logarithm of the odds that it exists; of a new one 0


def predict(mean: np.ndarray, covariance: np.ndarray, dt: float, jerk: float):
    """Return means (n, 3, 2) and covariances (n, 3, 3) `dt` [s] later.

    jerk: m/s^2 by which the acceleration changes in 1 s, standard deviation
    """
    F = np.array([[1.0, dt, dt**2 / 2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    Q = jerk**2 * np.array(
        [
            [dt**5 / 20, dt**4 / 8, dt**3 / 6],
            [dt**4 / 8, dt**3 / 3, dt**2 / 2],
            [dt**3 / 6, dt**2 / 2, dt],
        ]
    )
    return F @ mean, F @ covariance @ F.T + Q


def update(
    known: Mapping[int, Track], seen: Sequence[Obstacle], dt: float, params: Tracker
) -> dict[int, Track]:
    """Return the tracks after a message, `dt` [s] after that of the known ones.

    Those of what is not in it any more are moved on, or left out where they are forgotten.
    """
    R = np.diag([params.position_m**2, params.velocity_mps**2])
    start = np.diag([*np.diag(R), START_MPS2**2])
    measured = np.array([(o.X, o.Y, o.vX, o.vY) for o in seen]).reshape(-1, 2, 2)
    begun = dict(zip((o.id for o in seen), measured))
    if not known or not 0.0 <= dt <= LONGEST_S:
        return {
            key: Track(np.vstack((z, np.zeros((1, 2)))), start, 0.0) for key, z in begun.items()
        }
    means, covariances = predict(
        np.array([t.mean for t in known.values()]),
        np.array([t.covariance for t in known.values()]),
        dt,
        params.jerk_mps3,
    )
    # those without a measurement get none: NaN
    nothing = np.full((2, 2), np.nan)
    error = np.array([begun.get(key, nothing) for key in known]) - means[:, :2]
    S_inverse = np.linalg.inv(covariances[:, :2, :2] + R)
    gain = covariances[:, :, :2] @ S_inverse
    distance = np.einsum('nia,nij,nja->n', error, S_inverse, error)
    updated = means + gain @ error, covariances - gain @ covariances[:, :2]
    tracks = {}
    for row, (key, old) in enumerate(known.items()):
        if key not in begun:
            odds = old.odds + math.log(params.missed)
            if odds > 0.0:
                tracks[key] = Track(means[row], covariances[row], odds)
        elif distance[row] <= GATE:
            odds = min(old.odds + math.log((1.0 - params.missed) / GHOST_AGAIN), SUREST)
            tracks[key] = Track(updated[0][row], updated[1][row], odds)
    for key, z in begun.items():
        if key not in tracks:
            tracks[key] = Track(np.vstack((z, np.zeros((1, 2)))), start, 0.0)
    return tracks
