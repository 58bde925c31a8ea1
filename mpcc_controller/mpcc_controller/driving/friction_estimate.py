"""Estimate of the road's friction from the motion of the car: a bank of models. SI units.

Every hypothesis is a single track on a road of another friction. At each tick all of them predict
the velocities of the measured state from those of the tick before, under the set-points that acted
meanwhile. A hypothesis is the more probable, the better it predicted: a static multiple-model
filter with exponential forgetting (Bar-Shalom, Li, Kirubarajan, Estimation with Applications to
Tracking and Navigation, 2001, section 11.6.2). That tyre forces below the limit tell the friction:
Gustafsson, Automatica 33(6), 1997; from lateral motion: Hahn, Rajamani, Alexander, IEEE Trans.
Control Systems Technology 10(3), 2002; an estimate with its uncertainty for planning: Svensson et
al., "Fusion of heterogeneous friction estimates for traction adaptive motion planning", IEEE ITSC
2021.

A sideslip angle that is measured wrongly looks like forces that are not there, as on ice. Every
hypothesis therefore has a Kalman filter of that error, which straight driving makes known.

Where the hypotheses predict alike (no excitation) the probabilities stay, but for a slow return to
those of the start. What is believed is a low quantile: uncertainty makes the car careful.
"""

from collections.abc import Sequence
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import casadi as ca
import numpy as np

from mpcc_controller.driving import delay_compensation
from mpcc_controller.driving.delay_compensation import SetpointRamp
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, Input, State
from mpcc_controller.parameters import FrictionEstimate
from msgs_yaml import conversions
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import VehicleState
from stage_solver.compiled_functions import BufferedFunction, compile_functions

GRID_STEP = 0.05  # of the friction, between two hypotheses
LONGEST_S = 0.12  # between two states that are compared; over more the model is no measure
LEAST_SPEED_MPS = 5.0  # below it the model tells nothing of the friction
MAX_SIDESLIP = 0.35  # rad; beyond 20 deg the forces of the model are no measure of the friction
MAX_DISTANCE = 15.0  # square of standard deviations: one wild state must not decide
ERROR_STEP = 1e-4  # rad, of differences over the sideslip error
VELOCITY_STEP = 1e-3  # m/s or rad/s, likewise over the velocities
SLOWEST_MPS = 1.0  # down to it a model that drives at every speed holds
NOISE_MEMORY_S = 3.0  # in which the measured noise is forgotten
LASTS = 0.5  # correlation of the errors of the model from tick to tick
MAX_DEVIATIONS = 4.0  # of a difference: one wild state does not tell the noise
FEWEST = 8.0  # differences that tell the noise; before, nothing is learnt of the road
MISFIT_MEMORY_S = 0.5  # likewise, what no hypothesis explains
ERROR_DRIFT_S = 60.0  # over which the sideslip error changes by its standard deviation
VELOCITIES = tuple(State._fields.index(name) for name in ('vx', 'vy', 'r'))
SETPOINTS = tuple(State._fields.index(name) for name in Setpoints._fields)


class FrictionBelief(NamedTuple):
    """What is believed of the road after a tick."""

    friction: float  # -, in the units of `model.friction`
    # root of the sum of squares of the largest differences between predictions, in standard
    # deviations: below about 1 a tick holds no information
    excitation: float


class FrictionMemory(NamedTuple):
    """What an estimator has learnt; its arrays are never changed in place."""

    log: np.ndarray  # (n,) of the probabilities of the hypotheses, without their common factor
    error: np.ndarray  # (n,) rad, of the sideslip angle as each hypothesis estimates it
    variance: np.ndarray  # (n,) rad^2, of that
    noise: np.ndarray  # (3,) (m/s)^2, (m/s)^2, (rad/s)^2: variances of the measured velocities
    squares: np.ndarray  # (3,) of successive differences, summed up
    products: np.ndarray  # (3,) of these with those of the tick before
    count: float  # of both
    misfit: float  # the largest mean square that no hypothesis explained, fading; 1 as expected
    last: VehicleState | None  # of the tick before
    velocities: np.ndarray | None = None  # (3, n) of that tick, as each hypothesis estimates them
    predicted: np.ndarray | None = None  # (3, 3) covariance of what was predicted for that tick
    left: np.ndarray | None = None  # (3, 3) of a residual, what was taken for noise then
    difference: np.ndarray | None = None  # (3,) measured in that tick less predicted
    excitation: float = 0.0


class FrictionEstimator:
    """Estimates friction and velocities from states 50 ms apart and the set-points between them.

    What it has learnt is passed in and out, `start` at first.
    """

    def __init__(
        self, params: FrictionEstimate, car: Car, lags: tuple[float, float], highest: float
    ):
        """`car` is that of friction `highest`, the most that is believed.

        `lags` are those of the steering and of the forces [s] behind their set-points.
        """
        self._params, self._lags = params, lags
        self.memory_s = max(lags) + params.lag_error_s  # of set-points
        n = max(round((highest - params.lowest) / GRID_STEP), 0) + 1
        self.grid = np.linspace(min(params.lowest, highest), highest, n)
        ideal = car._replace(steer_lag=0.0, force_lag=0.0)  # the delay of the set-points is theirs
        mu = ((share * car.mu_f, share * car.mu_r) for share in self.grid / highest)
        self._cars = np.array([ideal._replace(mu_f=front, mu_r=rear) for front, rear in mu])
        self._is_slow_known = bool(car.kinematic_below)
        # each hypothesis twice: the second one measures the effect of the sideslip error; then
        # the most probable one with other velocities, and with set-points that act later
        self._predict = BufferedFunction(_bank(2 * n + 6, single_track.structure(ideal)))
        likely = np.exp((self.grid - highest) / params.spread)
        prior = params.doubt / n + (1 - params.doubt) * likely / np.sum(likely)
        self._prior = np.log(prior)
        noise = (params.speed_noise_mps, params.lateral_noise_mps, params.yaw_rate_noise_radps)
        self._model_variance = np.square(noise)
        self.start = FrictionMemory(  # the belief of the start
            log=self._prior,
            error=np.zeros(n),
            variance=np.full(n, params.sideslip_error_rad**2),
            noise=np.zeros(3),
            squares=np.zeros(3),
            products=np.zeros(3),
            count=0.0,
            misfit=1.0,
            last=None,
        )

    def probabilities(self, memory: FrictionMemory) -> np.ndarray:
        """Return the probability of every hypothesis of `grid`."""
        p = np.exp(memory.log - np.max(memory.log))
        return p / np.sum(p)

    def belief(self, memory: FrictionMemory) -> FrictionBelief:
        """Return the quantile of the friction, linear between hypotheses, and the excitation."""
        upto = np.cumsum(self.probabilities(memory))
        # the probability of a hypothesis is spread over the interval that ends at it
        corners = np.concatenate((self.grid[:1], self.grid))
        friction = np.interp(self._params.quantile, np.concatenate(([0.0], upto)), corners)
        return FrictionBelief(float(friction), memory.excitation)

    def update(
        self, before: FrictionMemory, x: VehicleState, ramps: Sequence[SetpointRamp]
    ) -> FrictionMemory:
        """Return what is learnt from the state of a tick.

        `ramps` are those of the set-points sent so far, the newest last.
        """
        if not np.all(np.isfinite(x)):
            return before._replace(last=None, excitation=0.0)
        measured = np.array([x.vx, x.vy, x.r])
        now = before._replace(
            last=x,
            velocities=np.tile(measured[:, None], len(self.grid)),
            predicted=np.zeros((3, 3)),
            left=np.zeros((3, 3)),
            difference=None,
            excitation=0.0,
        )
        if before.last is None:
            return now
        duration_s = conversions.ns_to_s(x.stamp_ns - before.last.stamp_ns)
        slowest = SLOWEST_MPS if self._is_slow_known else LEAST_SPEED_MPS
        is_modelled = all(  # not too slow, without much sideslip
            state.vx > slowest and abs(state.vy) <= np.tan(MAX_SIDESLIP) * state.vx
            for state in (before.last, x)
        )
        if 0 < duration_s <= LONGEST_S and is_modelled:
            return self._compare(before, now, measured, duration_s, ramps)
        return now

    def filtered(self, memory: FrictionMemory, x: VehicleState) -> VehicleState:
        """Return the state given to `update` with the velocities that are estimated from it.

        Where no noise was measured these are the measured ones.
        """
        if memory.last is not x or not np.any(memory.noise):
            return x
        vx, vy, r = map(float, memory.velocities @ self.probabilities(memory))
        return x._replace(vx=vx, vy=vy, r=r)

    def _compare(
        self, before: FrictionMemory, now: FrictionMemory, measured, duration_s, ramps
    ) -> FrictionMemory:
        """Return what predictions from the tick before tell beside the measured velocities."""
        best = int(np.argmax(before.log))
        residuals, slopes, transition, by_lags, difference = self._residuals(
            before, now.last.stamp_ns, best, measured, duration_s, ramps
        )
        now = self._measure_noise(before, now, difference, transition, duration_s)
        noise = np.diag(now.noise)
        # of the estimate before, as it was made, by the noise as it is known now
        left, gain = before.left, np.eye(3) - before.left
        covariance = left @ before.predicted @ left.T + gain @ noise @ gain.T
        predicted = transition @ covariance @ transition.T + np.diag(self._model_variance)
        predicted = predicted + by_lags @ by_lags.T
        information = np.linalg.inv(predicted + noise)
        is_fast = min(before.last.vx, measured[0]) > LEAST_SPEED_MPS
        if is_fast and now.count >= FEWEST:
            now = self._weigh(now, residuals, slopes, information, duration_s)
        left = noise @ information
        spread = np.ptp(residuals, axis=1)
        return now._replace(
            velocities=measured[:, None] - left @ residuals,
            predicted=predicted,
            left=left,
            excitation=float(np.sqrt(spread @ information @ spread)),
        )

    def _measure_noise(
        self, before: FrictionMemory, now: FrictionMemory, difference, transition, duration_s
    ) -> FrictionMemory:
        """Return the memory with the variances of the measured velocities.

        `difference` d (3,) is that between measured velocities and those predicted from the
        measured ones of the tick before, of which it has `transition` F times the noise. With
        white noise of variances R, and a model whose errors have variances M and last,

            E[d_k^2] = R + F^2 R + M,   E[d_k d_(k-1)] = -F R + LASTS M,

        squares and products by component: successive differences tell noise from errors of the
        model (Mehra, IEEE Trans. Automatic Control 15(2), 1970).
        """
        likely = self._model_variance + before.noise + transition**2 @ before.noise
        difference = np.clip(difference, *(MAX_DEVIATIONS * np.sqrt(likely) * [[-1.0], [1.0]]))
        squares, products, count = before.squares, before.products, before.count
        if before.difference is not None:
            kept = np.exp(-duration_s / NOISE_MEMORY_S)
            squares = kept * squares + difference**2
            products = kept * products + difference * before.difference
            count = kept * count + 1.0
        known = (LASTS * squares - products) / (count + 1.0)
        own = np.diag(np.diag(transition))
        noise = np.linalg.solve(LASTS * (np.eye(3) + transition**2) + own, known)
        return now._replace(
            squares=squares,
            products=products,
            count=count,
            noise=np.maximum(noise, 0.0),
            difference=difference,
        )

    def _weigh(
        self, memory: FrictionMemory, residuals, slopes, information, duration_s
    ) -> FrictionMemory:
        """Return the memory with new probabilities, and the sideslip error by hypothesis.

        That is estimated by a Kalman filter each.

        `residuals` and their `slopes` over the sideslip error are (3, n), `information` is the
        inverse of the covariance of the residuals beside that error.
        """
        params = self._params
        variance = memory.variance + params.sideslip_error_rad**2 * duration_s / ERROR_DRIFT_S
        # of the residuals with the covariance 1 / information + slope variance slope'
        gained = np.sum(slopes * (information @ slopes), axis=0)
        push = np.sum(slopes * (information @ residuals), axis=0)
        square = np.sum(residuals * (information @ residuals), axis=0)
        distance = square - variance / (1 + variance * gained) * push**2
        # what a hypothesis cannot explain tells it nothing of its sideslip error
        credible = distance <= MAX_DISTANCE
        # where not even the best hypothesis predicts, all of it tells less
        least = float(np.min(distance)) / len(residuals)
        misfit = max(np.exp(-duration_s / MISFIT_MEMORY_S) * memory.misfit, least)
        doubt = max(misfit, 1.0)
        growth = 1 + variance * gained / doubt
        posterior = variance / growth
        distance = (square - posterior * push**2 / doubt) / doubt
        likelihood = -(np.minimum(distance, MAX_DISTANCE) + np.log(growth)) / 2
        faded = np.exp(-duration_s / params.memory_s)
        log = faded * memory.log + (1 - faded) * self._prior + likelihood
        return memory._replace(
            log=log - np.max(log),
            error=memory.error - np.where(credible, posterior * push / doubt, 0.0),
            variance=np.where(credible, posterior, variance),
            misfit=misfit,
        )

    def _residuals(self, before: FrictionMemory, stamp_ns, best: int, measured, duration_s, ramps):
        """Return measured minus predicted velocities, and what they depend on.

        The residuals (3, n) of all hypotheses and their slopes over the sideslip error; of the
        hypothesis `best` the derivatives of the prediction by the velocities before (3, 3), by how
        much the likely errors of the lags of steering and forces move it (3, 2), and the difference
        (3,) from the prediction that begins at the measured velocities.
        """
        n, last = len(self.grid), before.last
        steps = int(np.ceil(duration_s / delay_compensation.MAX_STEP_S))
        instants = np.linspace(last.stamp_ns, stamp_ns, steps + 1)
        acting = [self._acting(ramps, ns, self._lags) for ns in instants.tolist()]
        # these columns have the rates of the others: at a corner they are late by half a step less
        late = [lag + self._params.lag_error_s for lag in self._lags]
        delayed = [self._acting(ramps, ns, late)[0] for ns in instants.tolist()]
        h = duration_s / steps
        which = np.concatenate((np.arange(n), np.arange(n), np.full(6, best)))
        error = before.error[which]
        error[n : 2 * n] += ERROR_STEP
        begin = before.velocities[:, which]
        begin[:, 2 * n : 2 * n + 3] += VELOCITY_STEP * np.eye(3)
        begin[:, 2 * n + 3] = last.vx, last.vy, last.r
        X = np.zeros((len(which), len(State._fields)))  # columns of CasADi are rows of numpy
        X[:, VELOCITIES] = _turned(begin, error).T
        self._predict.arguments['cars'][:] = self._cars[which].ravel()
        for ((start, lambda_b), (end, _)), other in zip(pairwise(acting), delayed):
            X[:, SETPOINTS] = start
            X[-2, SETPOINTS[0]], X[-1, SETPOINTS[1]] = other
            u = Input((end.delta - start.delta) / h, (end.Fx - start.Fx) / h, lambda_b, 0.0)
            X = self._predict(X=X.ravel(), u=u, h=h)['X_next'].reshape(X.shape)
        predicted = X[:, VELOCITIES].T
        all_residuals = _turned(np.tile(measured[:, None], len(which)), error) - predicted
        ends = (0, n, 2 * n, 2 * n + 3, 2 * n + 4, None)
        parts = (all_residuals[:, begin:end] for begin, end in pairwise(ends))
        residuals, shifted, moved, raw, later = parts
        slopes = (shifted - residuals) / ERROR_STEP
        transition = (residuals[:, best, None] - moved) / VELOCITY_STEP
        return residuals, slopes, transition, residuals[:, best, None] - later, raw[:, 0]

    @staticmethod
    def _acting(ramps, stamp_ns: float, lags) -> tuple[Setpoints, float]:
        """Return the set-points that act at an instant, and the brake split that came with Fx."""
        steer, force = (
            delay_compensation.setpoints_at(ramps, round(stamp_ns - lag * NS_PER_S)) for lag in lags
        )
        return Setpoints(steer[0].delta, force[0].Fx), force[1]


def _turned(velocities: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return vx, vy and r (3, n), measured with errors of the sideslip angle, without them."""
    vx, vy, r = velocities
    return np.array([vx, vy - error * vx, r])


@cache
def _bank(columns: int, structure: Car) -> ca.Function:
    """Return (X, u, h, cars) -> states (9, columns) one midpoint step of h [s] after X.

    Column i is that of the car in column i of `cars`.
    """
    X = ca.MX.sym('X', len(State._fields), columns)
    cars = ca.MX.sym('c', len(structure), columns)
    U, H = ca.MX.sym('u', len(Input._fields)), ca.MX.sym('h')
    each = (ca.repmat(value, 1, columns) for value in (U, H))
    name, arguments = f'friction_bank_{columns}', [X, U, H, cars]
    rows = delay_compensation.midpoint_step(structure).map(columns)(X, *each, cars)
    bank = ca.Function(name, arguments, [rows], ['X', 'u', 'h', 'cars'], ['X_next'])
    return compile_functions({name: bank}, name)[name]
