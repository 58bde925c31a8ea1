"""The prediction model over many windows of a log at once, and its fit to them.

Every window starts from a free lateral state and follows the measured speed, longitudinal
acceleration and steer. The fit is least squares (scipy, `soft_l1`) on lateral speed and yaw rate.
Its intervals are those of a wild bootstrap over blocks of half a second: residuals that follow each
other depend on each other.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import find_objects, label
from scipy.optimize import least_squares
from scipy.stats import t as student

from bags.errors import BagError
from experiments.configuration import inputs
from experiments.measured.measured_log import STEP_S, Log
from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import GRAVITY, Car, Input, State
from mpcc_controller.parameters import CarParams
from mpcc_controller.problem import stage_parameters

WINDOW_S, LEAST_SPEED_MPS = 2.0, 6.0
LONGEST_DELAY_S = 0.3
MOST_STEPS = 400  # of the fit
MOST_WINDOWS, LEAST_WINDOWS = 200, 5
SCALES = (0.1, 0.02)  # m/s and rad/s: vy and r of a residual of size 1
EVERY = 2  # rows of a residual: signals have passed a filter of 8 Hz
MODEL_STEP_S = 0.05
CONTROLLER = 'mpcc'  # whose numbers of the model are taken
BLOCK_S, CONFIDENCE = 0.5, 0.95
# half width over the value, or over the range of what may be 0: the log tells less
VAGUE = 0.2


class Kind(NamedTuple):
    """A parameter of the fit."""

    low: float
    high: float
    scale: float  # change that counts as one
    start: float  # of the fit; of a stiffness per load of its axle [1/rad]
    unit: str
    meaning: str


KINDS = {
    'front_cornering_npr': Kind(1e4, 5e5, 1e5, 15.0, 'N/rad', 'cornering stiffness, front axle'),
    'rear_cornering_npr': Kind(1e4, 5e5, 1e5, 15.0, 'N/rad', 'cornering stiffness, rear axle'),
    'front_friction': Kind(0.2, 2.5, 0.3, 1.0, '-', 'peak lateral force over load, front'),
    'rear_friction': Kind(0.2, 2.5, 0.3, 1.0, '-', 'peak lateral force over load, rear'),
    'cog_to_front_m': Kind(-0.1, 0.1, 0.1, 0.0, 'm', "CoG to front axle, beyond the map's"),
    'steer_offset_rad': Kind(-0.05, 0.05, 0.01, 0.0, 'rad', 'added to the measured steer'),
    'steer_delay_s': Kind(0.0, 0.25, 0.05, 0.03, 's', 'of the wheels behind the steer'),
    'sideslip_offset_rad': Kind(-0.05, 0.05, 0.01, 0.0, 'rad', 'of the measured sideslip'),
    'compliance_radpn': Kind(0.0, 3e-5, 2e-6, 5e-7, 'rad/N', 'steering compliance'),
}
# fitted only where it is asked for: seldom a log tells it from the stiffness of the front axle
COMPLIANCE = 'compliance_radpn'
# of `Windows`, what a model says: its label, and how many of the label's units are one in SI
SIGNALS = {
    'r': ('yaw rate [deg/s]', 180 / np.pi),
    'ay': ('lateral acceleration [m/s²]', 1.0),
    'vy': ('lateral speed [m/s]', 1.0),
    'sideslip': ('sideslip [deg]', 180 / np.pi),
}


class Windows(NamedTuple):
    """Windows of a log, or of a model: arrays (rows, windows).

    As measured, `steer` begins LONGEST_DELAY_S earlier.
    """

    steer: np.ndarray
    vx: np.ndarray
    vy: np.ndarray
    r: np.ndarray
    ax: np.ndarray
    ay: np.ndarray

    @property
    def sideslip(self) -> np.ndarray:
        """The sideslip angle [rad]."""
        return np.arctan2(self.vy, self.vx)

    def take(self, columns: Any) -> 'Windows':
        """Return some of the windows."""
        return Windows(*(array[:, columns] for array in self))

    def corrected(self, values: Mapping[str, Any]) -> 'Windows':
        """Return the windows without what parameters of a fit say is wrong in the measurement.

        `steer` (rows, windows) is that of the wheels. A value may be an array (windows,).
        """
        rows, columns = self.vx.shape
        back = np.broadcast_to(values.get('steer_delay_s', 0.0) / STEP_S, columns)
        whole = np.floor(back).astype(int)
        share = back - whole
        at = len(self.steer) - rows + np.arange(rows)[:, None] - whole
        now, before = (self.steer[k, np.arange(columns)] for k in (at, np.maximum(at - 1, 0)))
        steer = now * (1 - share) + before * share + values.get('steer_offset_rad', 0.0)
        return self._replace(
            steer=steer, vy=self.vy - self.vx * values.get('sideslip_offset_rad', 0.0)
        )


class Fit(NamedTuple):
    """A fit: values, half widths of 95 % and what is not told, by parameter."""

    values: dict[str, float]
    half_widths: dict[str, float]
    vague: tuple[str, ...]  # parameters that the log does not tell
    correlated: tuple[str, str, float]  # the two that are hardest to tell apart


def cut(logs: Sequence[Log], seconds: float = WINDOW_S, every: float | None = None) -> Windows:
    """Return the windows of valid driving, one after the other or one `every` seconds.

    Raises BagError where there is none.
    """
    count, margin = round(seconds / STEP_S), round(LONGEST_DELAY_S / STEP_S)
    stride = count if every is None else round(every / STEP_S)
    parts = [
        window(log, first, first + count + 1)
        for log in logs
        for begin, end in stretches(usable(log))
        for first in range(begin + margin, end - count, stride)
    ]
    if not parts:
        raise BagError(
            f'{", ".join(log.name for log in logs)}: no {seconds:g} s of valid driving above '
            f'{LEAST_SPEED_MPS:g} m/s'
        )
    return Windows(*(np.concatenate(arrays, axis=1) for arrays in zip(*parts)))


def usable(log: Log) -> np.ndarray:
    """Return which rows of a log are judged: valid ones, above LEAST_SPEED_MPS."""
    return log.valid & (log.vx > LEAST_SPEED_MPS)


def stretches(chosen: np.ndarray) -> list[tuple[int, int]]:
    """Return (first, one past the last) of each run of true rows."""
    return [(rows.start, rows.stop) for (rows,) in find_objects(label(chosen)[0])]


def window(log: Log, begin: int, end: int) -> Windows:
    """Return the rows `begin` to `end` of a log, `end` not included, as one window."""
    first = begin - round(LONGEST_DELAY_S / STEP_S)
    columns = log.steer[first:end], *(getattr(log, n)[begin:end] for n in Windows._fields[1:])
    return Windows(*(column[:, None] for column in columns))


def simulate(car: CarParams, values: Mapping[str, Any], windows: Windows) -> Windows:
    """Return what `predict` makes of corrected windows with the parameters of a fit.

    `values` are numbers, or arrays with a value for each window.
    """
    model = stage_parameters.car(inputs.controller_params(CONTROLLER), car)
    moved = values['cog_to_front_m']
    model = model._replace(
        l_f=model.l_f + moved,
        l_r=model.l_r - moved,
        C_f=values['front_cornering_npr'],
        C_r=values['rear_cornering_npr'],
        mu_f=values['front_friction'],
        mu_r=values['rear_friction'],
        compliance=values.get(COMPLIANCE, 0.0),
    )
    return predict(model, windows)


def predict(model: Car, windows: Windows) -> Windows:
    """Return the motion of the prediction model in corrected windows, from their first row on.

    Its speed and its force are the measured ones at every step of the model. The parameters of the
    model are numbers, or arrays with a value for each window.
    """
    rows, columns = windows.vx.shape
    dt, t = MODEL_STEP_S, np.arange(rows) * STEP_S
    at = np.arange(0, t[-1] + dt / 2, dt)
    step = single_track.step(dt, single_track.structure(model)).map(columns)
    cars = np.array([np.broadcast_to(value, columns) for value in model], float)
    vx, ax, steer = (_sampled(at, t, x) for x in (windows.vx, windows.ax, windows.steer))
    force = model.m * ax + model.drag * vx**2 + model.rolling
    steer_rate = np.diff(steer, axis=0, append=steer[-1:]) / dt
    mean_vx = (vx + np.vstack([vx[1:], vx[-1:]])) / 2
    vy, r, zero = windows.vy[0], windows.r[0], np.zeros(columns)
    out = np.empty((3, len(at), columns))
    for k in range(len(at)):
        x = State(zero, zero, zero, vx[k], vy, r, zero, steer[k], force[k])
        u = Input(steer_rate[k], zero, single_track.ideal_split(force[k], model), zero)
        following = State(*step(np.array(x), np.array(u), cars).full())
        ay = (following.vy - vy) / dt + mean_vx[k] * (r + following.r) / 2
        out[:, k] = vy, r, ay
        vy, r = following.vy, following.r
    vy, r, ay = (_sampled(t, at, values) for values in out)
    return windows._replace(vy=vy, r=r, ay=ay)


def _sampled(t, known, values):
    return np.column_stack([np.interp(t, known, column) for column in values.T])


def fit(
    logs: Sequence[Log],
    car: CarParams,
    fixed: Mapping[str, float] | None = None,
    compliant: bool = False,
) -> Fit:
    """Fit to the logs; `fixed` parameters keep their values. `compliant`: with a soft steering.

    Raises BagError for too few windows, and where no end is found.
    """
    windows = cut(logs)
    count = windows.vx.shape[1]
    if count < LEAST_WINDOWS:
        raise BagError(
            f'{count} windows of {WINDOW_S:g} s above {LEAST_SPEED_MPS:g} m/s; at least '
            f'{LEAST_WINDOWS} are needed'
        )
    # those in which the car turns most
    windows = windows.take(np.sort(np.argsort(np.ptp(windows.r, axis=0))[-MOST_WINDOWS:]))
    fixed = dict(fixed or {})
    names = [n for n in KINDS if n not in fixed and (compliant or n != COMPLIANCE)]
    problem = _Problem(car, windows, names, fixed)
    functions = problem.residuals, problem.x0, problem.jacobian, problem.bounds
    ends = {'xtol': 1e-5, 'ftol': 1e-6, 'max_nfev': MOST_STEPS}
    solution = least_squares(*functions, loss='soft_l1', **ends)
    if not solution.success:
        raise BagError(f'the fit has not ended after {MOST_STEPS} steps: --fix what is not told')
    half_widths, correlation = problem.intervals(solution.x)
    sizes = (x[: len(names)] * problem.scale[:-2] for x in (solution.x, half_widths))
    values, half = (dict(zip(names, size.tolist())) for size in sizes)
    vague = tuple(name for name in names if _is_vague(KINDS[name], values[name], half[name]))
    i, k = np.unravel_index(np.argmax(np.abs(np.triu(correlation, 1))), correlation.shape)
    correlated = names[i], names[k], float(correlation[i, k])
    return Fit(fixed | values, half, vague, correlated)


def _is_vague(kind, value, half):
    at_bound = min(value - kind.low, kind.high - value) < 1e-3 * (kind.high - kind.low)
    # a delay or a compliance of nothing is an answer
    is_pushed = at_bound and (kind.low < 0 or value > kind.low + kind.scale)
    return is_pushed or half > VAGUE * (value if kind.low > 0 else kind.high - kind.low)


class _Problem:
    """Residuals of all windows and their derivatives by differences, every column at once.

    What is sought, x, are the parameters and then vy and r at the start of each window, by `scale`.
    Residuals are (windows, rows and signals).
    """

    def __init__(self, car, windows, names, fixed):
        self.car, self.windows, self.names, self.fixed = car, windows, names, fixed
        kinds, states = [KINDS[name] for name in names], np.array([windows.vy[0], windows.r[0]])
        scale, self.count = np.array([kind.scale for kind in kinds]), windows.vx.shape[1]
        self.scale, load = np.append(scale, SCALES), car.car.mass_kg * GRAVITY / 2
        low, high = np.array([(kind.low, kind.high) for kind in kinds]).T / scale
        start = [kind.start * (load if kind.unit == 'N/rad' else 1.0) for kind in kinds]
        start = np.clip(start / scale, low * 1.001, high * 0.999)
        self.x0 = np.concatenate([start, *(states.T / SCALES).T])
        free = np.full(states.size, np.inf)
        self.bounds = np.append(low, -free), np.append(high, free)

    def _changed(self, x, changes):
        """Return the residuals with each change (m, names + 2) of x: (m, windows, k)."""
        n, m = len(self.names), len(changes)
        own = np.vstack([np.repeat(x[:n, None], self.count, 1), x[n:].reshape(2, -1)])
        changed = (own[:, None] + changes.T[:, :, None]).reshape(n + 2, -1)
        *values, vy, r = changed * self.scale[:, None]
        values = self.fixed | dict(zip(self.names, values))
        windows = self.windows.take(np.tile(np.arange(self.count), m)).corrected(values)
        motion = simulate(self.car, values, windows._replace(vy=vy[None], r=r[None]))
        pairs = zip((motion.vy, motion.r), (windows.vy, windows.r), SCALES)
        parts = [(model - measured)[::EVERY].T / scale for model, measured, scale in pairs]
        return np.stack(parts, axis=-1).reshape(m, self.count, -1)

    def residuals(self, x):
        return self._changed(x, np.zeros((1, len(self.names) + 2))).ravel()

    def _derivatives(self, x, step=1e-4):
        """Return the residuals (windows, k), and their derivatives (windows, k, names + 2)."""
        n = len(self.names)
        # inwards, away from the upper bound
        signs = np.append(np.where(x[:n] > 0.9 * self.bounds[1][:n], -1.0, 1.0), [1.0, 1.0])
        f, *others = self._changed(x, np.vstack([np.zeros(n + 2), np.diag(step * signs)]))
        return f, np.stack([other - f for other in others], axis=-1) / (step * signs)

    def jacobian(self, x):
        D, n, each = self._derivatives(x)[1], len(self.names), np.arange(self.count)
        result = np.zeros((*D.shape[:2], len(x)))
        result[..., :n] = D[..., :n]
        for k in (0, 1):  # the start of a window moves that window alone
            result[each, :, n + k * self.count + each] = D[..., n + k]
        return result.reshape(-1, len(x))

    def intervals(self, x):
        """Return half widths (names,) in units of the scale, and the correlations.

        Of each window the part of the residuals that its free start explains is projected out; what
        is left is weighted as soft_l1 does it. The variance is that of a wild bootstrap, which
        turns the sign of a whole block of residuals at random, linear about the optimum.
        """
        n = len(self.names)
        f, D = self._derivatives(x)
        weight = (1 + f**2) ** -0.25
        f, D = f * weight, D * weight[..., None]
        Q, _ = np.linalg.qr(D[..., n:])
        D = D[..., :n] - Q @ (Q.transpose(0, 2, 1) @ D[..., :n])
        H = np.tensordot(D, D, ((0, 1), (0, 1)))
        # keeps the matrix regular where the log says nothing: such a parameter moves freely
        inverse = np.linalg.inv(H + 1e-9 * np.trace(H) * np.eye(n))
        block = 2 * round(BLOCK_S / STEP_S / EVERY)
        g = np.add.reduceat(D * f[..., None], range(0, f.shape[1], block), axis=1).reshape(-1, n)
        freedom = max(len(g) - n, 1)
        # the fit has made the residuals smaller: as a jackknife corrects it, on average
        covariance = inverse @ (g.T @ g) @ inverse * (len(g) / freedom) ** 2
        half = student.ppf((1 + CONFIDENCE) / 2, freedom) * np.sqrt(np.diag(covariance))
        size = np.sqrt(np.diag(inverse))
        return half, inverse / np.outer(size, size)
