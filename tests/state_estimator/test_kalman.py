"""The algebra of the filter against that of textbooks, for any states."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from state_estimator.kalman import Instant, correct_late

N, STEPS = 5, 4
SEEDS = st.integers(0, 2**32 - 1)


def begin(rng):
    """Return an instant with some state and covariance."""
    instant, root = Instant(0, N), rng.normal(size=(N, N))
    instant.x[:], instant.P[:] = rng.normal(size=N), root @ root.T + np.eye(N)
    return instant


@given(SEEDS)
def test_a_step_and_a_measurement_are_those_of_a_kalman_filter(seed):
    rng = np.random.default_rng(seed)
    before = begin(rng)
    F, variances, h = rng.normal(size=(N, N)), rng.uniform(size=N), rng.normal(size=N)
    now = before.next(1, F @ before.x, F, variances)
    P, x = F @ before.P @ F.T + np.diag(variances), F @ before.x
    assert np.allclose(now.P, P)
    assert np.array_equal(now.P, now.P.T)
    now.correct(h, 0.7, 0.2)
    K = P @ h / (h @ P @ h + 0.2)
    kept = np.eye(N) - np.outer(K, h)
    assert np.allclose(now.x, x + 0.7 * K)
    assert np.allclose(now.P, kept @ P @ kept.T + 0.2 * np.outer(K, K), atol=1e-9)  # of Joseph
    assert np.allclose(now.A_T.T, kept @ F)


@given(SEEDS)
def test_a_late_measurement_ends_where_it_does_in_time(seed):
    rng = np.random.default_rng(seed)
    H, R = rng.normal(size=(2, N)), np.diag(rng.uniform(0.1, 1.0, 2))
    z, F = rng.normal(size=2), np.eye(N) + 0.3 * rng.normal(size=(N, N))
    start, ends = rng.integers(2**32), []
    for is_late in (False, True):
        instants = [begin(np.random.default_rng(start))]
        for _ in range(STEPS * is_late):
            instants.append(instants[-1].next(0, F @ instants[-1].x, F, np.ones(N)))
        first = instants[0]
        correct_late(instants, H, H @ first.P @ H.T + R, z - H @ first.x)
        while len(instants) <= STEPS:
            instants.append(instants[-1].next(0, F @ instants[-1].x, F, np.ones(N)))
        ends.append(instants[-1])
    assert np.allclose(ends[0].x, ends[1].x)
    assert np.allclose(ends[0].P, ends[1].P)
