"""The single track with Fiala tyres over many windows of a log at once, and its fit to them.

Every window starts from a free lateral state and follows the measured speed, longitudinal
acceleration and steer. Without additions it is the prediction model (mpcc_controller, single
track), which a test holds against it. The additions are what a single track lacks:

  relaxation   the slip of each axle follows its steady value over a length (PT1 over distance)
  load         stiffness and friction of an axle fall with the square of the lateral acceleration,
               as lateral load transfer does it, whose delay is that of the body's roll
  compliance   the front wheels give way by an angle per lateral force

The fit is least squares (scipy, `soft_l1`) on lateral speed and yaw rate. Its intervals are those
of a wild bootstrap over blocks of half a second: residuals that follow each other depend on each
other.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import find_objects, label
from scipy.optimize import least_squares
from scipy.stats import t as student

from bags.errors import BagError
from experiments.measured.measured_log import STEP_S, Log
from mpcc_controller.parameters import CarParams

GRAVITY = 9.81
WINDOW_S, LEAST_SPEED_MPS = 2.0, 6.0
LONGEST_DELAY_S = 0.3
MOST_STEPS = 400  # of the fit
MOST_WINDOWS, LEAST_WINDOWS = 200, 5
SCALES = (0.1, 0.02)  # m/s and rad/s: vy and r of a residual of size 1
EVERY = 2  # rows of a residual: signals have passed a filter of 8 Hz
ROLL_S = 0.1  # delay of lateral load transfer
NEWTON_STEPS = 3  # of the steering compliance
LONGITUDINAL_SHARE = 0.95  # of the friction that a longitudinal force takes at most
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
    'relaxation_m': Kind(0.0, 3.0, 0.3, 0.3, 'm', 'relaxation length of both axles'),
    'load_front': Kind(0.0, 0.6, 0.1, 0.1, '-', 'loss of the front axle at 1 g'),
    'load_rear': Kind(0.0, 0.6, 0.1, 0.1, '-', 'loss of the rear axle at 1 g'),
    'compliance_radpn': Kind(0.0, 3e-5, 2e-6, 5e-7, 'rad/N', 'steering compliance'),
}
BASIC = tuple(KINDS)[:8]
ADDITIONS = ('relaxation', 'load', 'compliance')  # with these words their parameters begin
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
    additions: tuple[str, ...]


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


def axle_force(z: Any, stiffness: Any, capacity: Any) -> Any:
    """Return the lateral force of a Fiala axle [N] at the tangent of its slip angle."""
    q = np.minimum(np.abs(z) * stiffness / (3 * capacity), 1.0)
    return -np.sign(z) * capacity * (3 * q - 3 * q**2 + q**3)


def _given_way(slip, stiffness, capacity, compliance):
    """Return the angle by which the front wheels give way to the force of their slip angle."""
    if not compliance.any():
        return 0.0
    stiff, size = compliance * stiffness, np.abs(slip)
    given = np.minimum(size, compliance * capacity)  # from above Newton's method converges
    for _ in range(NEWTON_STEPS):
        q = np.minimum(np.tan(size - given) * stiffness / (3 * capacity), 1.0)
        wrong = given - compliance * capacity * (3 * q - 3 * q**2 + q**3)
        given = given - wrong / (1 + stiff * (1 - q) ** 2)
    return np.copysign(given, slip)


def simulate(car: CarParams, values: Mapping[str, Any], windows: Windows) -> Windows:
    """Return the motion of the single track in corrected windows, from their first row on.

    `values` are numbers, or arrays with a value for each window; what is missing is 0.
    """
    p = {name: np.asarray(values.get(name, 0.0)) for name in KINDS}
    body, drive_front = car.car, car.actuators.drive_front_share
    m, L = body.mass_kg, body.cog_to_front_m + body.cog_to_rear_m
    lf = body.cog_to_front_m + p['cog_to_front_m']
    lr = L - lf

    def rates(vy, r, lagged, vx, ax, delta, roll_ay, fraction):
        """Return dvy/dt, dr/dt, ay and the steady slips of both axles.

        The slips that act have come from `lagged` nearer to these by a `fraction` of the way.
        """
        Fx = m * ax + body.drag_n_per_mps2 * vx**2 + body.rolling_n
        Fzf = (m * GRAVITY * lr - body.cog_height_m * Fx) / L
        Fzr = (m * GRAVITY * lf + body.cog_height_m * Fx) / L
        front = np.where(Fx > 0, drive_front, Fzf / (Fzf + Fzr))
        loss = (roll_ay / GRAVITY) ** 2
        axles = []
        for name, Fz, share in (('front', Fzf, front), ('rear', Fzr, 1 - front)):
            left = 1 - p[f'load_{name}'] * loss
            grip = p[f'{name}_friction'] * Fz * left
            along = np.clip(share * Fx, -LONGITUDINAL_SHARE * grip, LONGITUDINAL_SHARE * grip)
            axles.append((p[f'{name}_cornering_npr'] * left, np.sqrt(grip**2 - along**2), along))
        (Cf, Gf, Xf), (Cr, Gr, _) = axles
        slip = np.arctan((vy + lf * r) / vx) - delta
        given = _given_way(slip, Cf, Gf, p['compliance_radpn'])
        steady, turned = (np.tan(slip - given), (vy - lr * r) / vx), delta + given
        zf, zr = (old + (new - old) * fraction for old, new in zip(lagged, steady))
        Ff, Fr = axle_force(zf, Cf, Gf), axle_force(zr, Cr, Gr)
        Yf = Ff * np.cos(turned) + Xf * np.sin(turned)
        ay = (Yf + Fr) / m
        return ay - vx * r, (lf * Yf - lr * Fr) / body.yaw_inertia_kgm2, ay, steady

    rows, columns = windows.vx.shape
    inputs = windows.vx, windows.ax, windows.steer
    vy, r, ay = windows.vy[0], windows.r[0], windows.ay[0]
    # so that the axles have the slip of their steady state at the start
    lagged = rates(vy, r, (0.0, 0.0), *(a[0] for a in inputs), ay, 1.0)[3]
    roll_ay, out = ay, np.empty((3, rows, columns))
    relaxation = np.maximum(p['relaxation_m'], 1e-6)
    at_once = np.where(relaxation > 1e-6, 0.0, 1.0)
    rolled = 1 - np.exp(-STEP_S / ROLL_S)
    for k in range(rows - 1):
        middle = [(a[k] + a[k + 1]) / 2 for a in inputs]
        half = 1 - np.exp(-middle[0] * STEP_S / 2 / relaxation)
        whole = 1 - np.exp(-middle[0] * STEP_S / relaxation)
        d_vy, d_r, ay, _ = rates(vy, r, lagged, *(a[k] for a in inputs), roll_ay, at_once)
        out[:, k] = vy, r, ay
        vy_m, r_m = vy + STEP_S / 2 * d_vy, r + STEP_S / 2 * d_r
        d_vy, d_r, ay, steady = rates(vy_m, r_m, lagged, *middle, roll_ay, half)
        lagged = tuple(old + (new - old) * whole for old, new in zip(lagged, steady))
        vy, r = vy + STEP_S * d_vy, r + STEP_S * d_r
        roll_ay = roll_ay + (ay - roll_ay) * rolled
    out[:, -1] = vy, r, ay
    return windows._replace(vy=out[0], r=out[1], ay=out[2])


def fit(
    logs: Sequence[Log],
    car: CarParams,
    additions: Sequence[str] = (),
    fixed: Mapping[str, float] | None = None,
) -> Fit:
    """Fit to the logs; `fixed` parameters keep their values.

    The additions are of ADDITIONS. Raises BagError for too few windows, and where no end is found.
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
    chosen = (name for name in KINDS if name in BASIC or name.startswith(tuple(additions)))
    names = [name for name in chosen if name not in fixed]
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
    return Fit(fixed | values, half, vague, correlated, tuple(additions))


def _is_vague(kind, value, half):
    at_bound = min(value - kind.low, kind.high - value) < 1e-3 * (kind.high - kind.low)
    # a delay, a length or a loss of nothing is an answer
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
