"""What a Kalman filter knows at an instant, and how measurements change it, late ones too.

Of any states: the equations of the car are in `filter`.
"""

from collections.abc import Sequence

import numpy as np


class Instant:
    """State and covariance, and the transition from the instant before.

    They are rows of one array: a scalar measurement takes a multiple of its gain from each of them.

    stamp_ns   its time
    x          (n,) state
    P          (n, n) covariance
    A_T        (n, n) (I - K H) F since the instant before, transposed: F, then every measurement
    """

    def __init__(self, stamp_ns: int, n: int):
        """Begin with zeros for `n` states."""
        self.stamp_ns = stamp_ns
        self._rows = np.zeros((2 * n + 1, n))
        self.P, self.A_T, self.x = self._rows[:n], self._rows[n:-1], self._rows[-1]

    def next(
        self, stamp_ns: int, x: Sequence[float], F: np.ndarray, variances: np.ndarray
    ) -> 'Instant':
        """Return the instant after this one.

        x: its state, (n,); F: Jacobian of x over the present state, (n, n); variances: of the noise
        since, (n,).
        """
        then = Instant(stamp_ns, len(F))
        then.x[:], then.A_T[:] = x, F.T
        P = F.dot(self.P).dot(F.T)
        np.add(P, P.T, out=then.P)
        then.P *= 0.5  # rounding leaves no covariance symmetric
        then.P.ravel()[:: len(F) + 1] += variances
        return then

    def correct(self, h: np.ndarray, innovation: float, R: float) -> None:
        """Use a scalar measurement with slopes h, (n,), over the state, and variance R."""
        n = len(h)
        column = self._rows.dot(h)  # P h; A^T h; h x, in whose place the innovation is
        Ph = column[:n]
        K = Ph / (h.dot(Ph) + R)
        column[-1] = -innovation
        self._rows -= column.reshape(-1, 1).dot(K.reshape(1, n))


def correct_late(
    instants: Sequence[Instant], H: np.ndarray, S: np.ndarray, innovation: np.ndarray
) -> None:
    """Use a measurement of the first of consecutive instants in all of them.

    The gain is that of the first, carried forward by the transitions since (Larsen, Andersen, Ravn,
    Poulsen, CDC 1998). H: slopes, (m, n); S: covariance of the innovation, (m, m).
    """
    first = instants[0]
    K = np.linalg.solve(S, H.dot(first.P)).T
    for instant in instants:
        if instant is not first:
            K = instant.A_T.T.dot(K)
        instant.x += K.dot(innovation)
        instant.P -= K.dot(S).dot(K.T)
