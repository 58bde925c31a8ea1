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

from mpcc_controller.driving.delay_compensation import MAX_STEP_S, SetpointRamp, setpoints_at
from mpcc_controller.driving.setpoints import Setpoints
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, Input, State
from mpcc_controller.parameters import ControllerParams, FrictionEstimate
from msgs_yaml import conversions
from msgs_yaml.conversions import NS_PER_S
from msgs_yaml.types import VehicleState
from stage_solver import stage_problem
from stage_solver.compiled_functions import BufferedFunction, compile_functions

GRID_STEP = 0.05  # of the friction, between two hypotheses
LONGEST_S = 0.12  # between two states that are compared; over more the model is no measure
LEAST_SPEED_MPS = 5.0  # below it the slip angles of the model are rounded (`v_slip`)
MAX_SIDESLIP = 0.35  # rad; beyond 20 deg the forces of the model are no measure of the friction
MAX_DISTANCE = 15.0  # square of standard deviations: one wild state must not decide
ERROR_STEP = 1e-4  # rad, of differences over the sideslip error
ERROR_DRIFT_S = 60.0  # over which the sideslip error changes by its standard deviation
VELOCITIES = tuple(State._fields.index(name) for name in ('vx', 'vy', 'r'))
SETPOINTS = tuple(State._fields.index(name) for name in Setpoints._fields)


class FrictionBelief(NamedTuple):
    """What is believed of the road after a tick."""

    friction: float  # -, in the units of `model.friction`
    # root of the sum of squares of the largest differences between predictions, in standard
    # deviations: below about 1 a tick holds no information
    excitation: float


class Memory(NamedTuple):
    """What an estimator has learnt; its arrays are never changed in place."""

    log: np.ndarray  # of the probabilities of the hypotheses, without their common factor
    error: np.ndarray  # rad, of the sideslip angle as each hypothesis estimates it
    variance: np.ndarray  # rad^2, of that
    last: VehicleState | None  # of the tick before
    excitation: float


class FrictionEstimator:
    """Estimates the friction from states 50 ms apart and the set-points between them."""

    def __init__(self, params: FrictionEstimate, car: Car, highest: float, compiled: bool = True):
        """`car` is that of friction `highest`, the most that is believed.

        compiled: the model is machine code.
        """
        self._params = params
        count = max(round((highest - params.lowest) / GRID_STEP), 0) + 1
        self.grid = np.linspace(min(params.lowest, highest), highest, count)
        # each hypothesis twice: the second one measures the effect of the sideslip error
        cars = np.tile([_on_road(car, share) for share in self.grid / highest], (2, 1))
        self._predict = BufferedFunction(_bank(2 * count, compiled))
        self._predict.arguments['cars'][:] = cars.ravel()
        likely = np.exp((self.grid - highest) / params.spread)
        prior = params.doubt / count + (1 - params.doubt) * likely / np.sum(likely)
        self._prior = np.log(prior)
        noise = (params.speed_noise_mps, params.lateral_noise_mps, params.yaw_rate_noise_radps)
        self._information = np.array(noise)[:, None] ** -2
        self.reset()

    def reset(self) -> None:
        """Return to the belief of the start."""
        self._log = self._prior.copy()  # of the probabilities, without their common factor
        # of each hypothesis: its estimate of the sideslip error [rad], and the variance
        self._error = np.zeros(len(self.grid))
        self._variance = np.full(len(self.grid), self._params.sideslip_error_rad**2)
        self._last: VehicleState | None = None
        self._excitation = 0.0

    @property
    def memory(self) -> Memory:
        """What was learnt; to set it is to go on from there."""
        return Memory(self._log, self._error, self._variance, self._last, self._excitation)

    @memory.setter
    def memory(self, memory: Memory) -> None:
        self._log, self._error, self._variance, self._last, self._excitation = memory

    @property
    def probabilities(self) -> np.ndarray:
        """The probability of every hypothesis of `grid`."""
        p = np.exp(self._log - np.max(self._log))
        return p / np.sum(p)

    @property
    def belief(self) -> FrictionBelief:
        """The quantile of the friction, linear between hypotheses, and the last excitation."""
        upto = np.cumsum(self.probabilities)
        # the probability of a hypothesis is spread over the interval that ends at it
        friction = np.interp(self._params.quantile, np.concatenate(([0.0], upto)), self._corners)
        return FrictionBelief(float(friction), self._excitation)

    @property
    def _corners(self):
        return np.concatenate((self.grid[:1], self.grid))

    def update(self, x: VehicleState, ramps: Sequence[SetpointRamp]) -> FrictionBelief:
        """Take the state of a tick, and the ramps of set-points sent so far, the newest last."""
        last, self._excitation = self._last, 0.0
        self._last = x if np.all(np.isfinite(x)) else None
        if last is None or self._last is None:
            return self.belief
        duration_s = conversions.ns_to_s(x.stamp_ns - last.stamp_ns)
        if not 0 < duration_s <= LONGEST_S or not (_is_informative(x) and _is_informative(last)):
            return self.belief
        residuals, slopes = self._residuals(last, x, duration_s, ramps)
        self._weigh(residuals, slopes, duration_s)
        spread = self._information * np.ptp(residuals, axis=1, keepdims=True) ** 2
        self._excitation = float(np.sqrt(np.sum(spread)))
        return self.belief

    def _weigh(self, residuals, slopes, duration_s):
        """Update probabilities, and the sideslip error of every hypothesis by its Kalman filter.

        `residuals` and their `slopes` over the sideslip error are (3, hypotheses).
        """
        params, w = self._params, self._information
        drift = params.sideslip_error_rad**2 * duration_s / ERROR_DRIFT_S
        self._variance = self._variance + drift
        # of the residuals with the covariance 1 / w + slope variance slope'
        gained = np.sum(w * slopes**2, axis=0)
        push = np.sum(w * slopes * residuals, axis=0)
        growth = 1 + self._variance * gained
        posterior = self._variance / growth
        distance = np.sum(w * residuals**2, axis=0) - posterior * push**2
        # what a hypothesis cannot explain tells it nothing of its sideslip error
        credible = distance <= MAX_DISTANCE
        self._variance = np.where(credible, posterior, self._variance)
        self._error = self._error - np.where(credible, posterior * push, 0.0)
        likelihood = -(np.minimum(distance, MAX_DISTANCE) + np.log(growth)) / 2
        kept = np.exp(-duration_s / params.memory_s)
        log = kept * self._log + (1 - kept) * self._prior + likelihood
        self._log = log - np.max(log)

    def _residuals(self, last, x, duration_s, ramps):
        """Return measured minus predicted velocities, and their slopes over the sideslip error."""
        steps = int(np.ceil(duration_s / MAX_STEP_S))
        delay_ns = round(self._params.actuator_delay_s * NS_PER_S)
        instants = np.linspace(last.stamp_ns - delay_ns, x.stamp_ns - delay_ns, steps + 1)
        points = [setpoints_at(ramps, round(ns)) for ns in instants.tolist()]
        h = duration_s / steps
        error = np.concatenate((self._error, self._error + ERROR_STEP))
        X = np.zeros((len(error), len(State._fields)))  # columns of CasADi are rows of numpy
        X[:, VELOCITIES] = _velocities(last, error).T
        for (begin, lambda_b), (end, _) in pairwise(points):
            X[:, SETPOINTS] = begin
            u = Input((end.delta - begin.delta) / h, (end.Fx - begin.Fx) / h, lambda_b, 0.0)
            X = self._predict(X=X.ravel(), u=u, h=h)['X_next'].reshape(X.shape)
        both = _velocities(x, error) - X[:, VELOCITIES].T
        residuals, shifted = np.split(both, 2, axis=1)
        return residuals, (shifted - residuals) / ERROR_STEP


def _velocities(x: VehicleState, error: np.ndarray) -> np.ndarray:
    """Return vx, vy and r (3, n) of a state whose measured sideslip angle has these errors."""
    return np.array([np.full_like(error, x.vx), x.vy - error * x.vx, np.full_like(error, x.r)])


def make(params: ControllerParams, car: Car) -> FrictionEstimator | None:
    """Return the estimator that the parameters ask for; None if it is off."""
    options = params.friction_estimate
    if not options.on:
        return None
    return FrictionEstimator(options, car, params.model.friction, params.solver.compiled)


def _on_road(car: Car, share: float) -> Car:
    """Return a car on a road of a share of its friction."""
    ideal = Car(*car[: len(Car._fields)])  # the delay of the set-points stands for the lags
    return ideal._replace(mu_f=share * car.mu_f, mu_r=share * car.mu_r)


def _is_informative(x: VehicleState) -> bool:
    """Return whether the model holds for a motion: not too slow, and without much sideslip."""
    return x.vx > LEAST_SPEED_MPS and abs(x.vy) <= np.tan(MAX_SIDESLIP) * x.vx


@cache
def _bank(columns: int, compiled: bool) -> ca.Function:
    """Return (X, u, h, cars) -> states (9, columns) one midpoint step of h [s] after X.

    Column i is that of the car in column i of `cars`.
    """
    x, u = ca.SX.sym('x', len(State._fields)), ca.SX.sym('u', len(Input._fields))
    h, numbers = ca.SX.sym('h'), ca.SX.sym('car', len(Car._fields))
    car = Car(*ca.vertsplit(numbers))
    rates = single_track.derivative(State(*ca.vertsplit(x)), Input(*ca.vertsplit(u)), car)
    f = ca.Function('rates', [x, u, numbers], [ca.vertcat(*rates)])
    step = ca.Function('step', [x, u, h, numbers], [stage_problem.rk2(f, h)(x, u, numbers)])
    X, cars = ca.MX.sym('X', len(State._fields), columns), ca.MX.sym('c', len(Car._fields), columns)
    U, H = ca.MX.sym('u', len(Input._fields)), ca.MX.sym('h')
    each = (ca.repmat(value, 1, columns) for value in (U, H))
    name, arguments = f'friction_bank_{columns}', [X, U, H, cars]
    rows = step.map(columns)(X, *each, cars)
    bank = ca.Function(name, arguments, [rows], ['X', 'u', 'h', 'cars'], ['X_next'])
    return compile_functions({name: bank}, name)[name] if compiled else bank
