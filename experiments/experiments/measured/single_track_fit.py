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

from bags.errors import BagError
from experiments.measured.measured_log import STEP_S, Log, stretches
from mpcc_controller.parameters import CarBody, CarParams

GRAVITY = 9.81
WINDOW_S, LEAST_SPEED_MPS = 2.0, 6.0
LONGEST_DELAY_S = 0.3
MOST_STEPS = 60  # of the fit
MOST_WINDOWS, LEAST_WINDOWS = 200, 5
SCALE_VY_MPS, SCALE_R_RADPS = 0.1, 0.02  # residuals of size 1
EVERY = 2  # rows of a residual: signals have passed a filter of 8 Hz
ROLL_S = 0.1  # delay of lateral load transfer
LONGITUDINAL_SHARE = 0.95  # of the friction that a longitudinal force takes at most
BLOCK_S, CONFIDENCE = 0.5, 0.95
# half width over the value, or over the range where there is no scale: the log tells less
VAGUE = 0.2


class Kind(NamedTuple):
    """A parameter of the fit."""

    low: float
    high: float
    scale: float  # change that counts as one
    start: float  # of the fit; of a stiffness per load of its axle [1/rad]
    unit: str
    meaning: str
    relative: bool = True  # its interval is judged relative to its value


STIFFNESSES = ('front_cornering_npr', 'rear_cornering_npr')
KINDS = {
    'front_cornering_npr': Kind(1e4, 8e5, 1e5, 15.0, 'N/rad', 'cornering stiffness, front axle'),
    'rear_cornering_npr': Kind(1e4, 8e5, 1e5, 15.0, 'N/rad', 'cornering stiffness, rear axle'),
    'front_friction': Kind(0.2, 2.5, 0.3, 1.0, '-', 'peak lateral force over load, front'),
    'rear_friction': Kind(0.2, 2.5, 0.3, 1.0, '-', 'peak lateral force over load, rear'),
    # from the map's
    'cog_to_front_m': Kind(-0.1, 0.1, 0.1, 0.0, 'm', 'CoG to front axle', False),
    'steer_offset_rad': Kind(-0.05, 0.05, 0.01, 0.0, 'rad', 'added to the measured steer', False),
    'steer_delay_s': Kind(0.0, 0.25, 0.05, 0.03, 's', 'of the wheels behind the steer', False),
    'sideslip_offset_rad': Kind(-0.05, 0.05, 0.01, 0.0, 'rad', 'of the measured sideslip', False),
    'relaxation_m': Kind(0.0, 3.0, 0.3, 0.3, 'm', 'relaxation length of both axles'),
    'load_front': Kind(0.0, 0.6, 0.1, 0.1, '-', 'loss of the front axle at 1 g', False),
    'load_rear': Kind(0.0, 0.6, 0.1, 0.1, '-', 'loss of the rear axle at 1 g', False),
    'compliance_radpn': Kind(0.0, 3e-5, 2e-6, 5e-7, 'rad/N', 'steering compliance', False),
}
BASIC = tuple(KINDS)[:8]
ADDITIONS = {
    'relaxation': ('relaxation_m',),
    'load': ('load_front', 'load_rear'),
    'compliance': ('compliance_radpn',),
}


class Windows(NamedTuple):
    """Measured windows, arrays (rows, windows); `steer` begins LONGEST_DELAY_S earlier."""

    steer: np.ndarray
    vx: np.ndarray
    vy: np.ndarray
    r: np.ndarray
    ax: np.ndarray
    ay: np.ndarray

    def take(self, columns: Any) -> 'Windows':
        """Return some of the windows."""
        return Windows(*(array[:, columns] for array in self))


class Fit(NamedTuple):
    """A fit: values, half widths of 95 % and what is not told, by parameter; residuals."""

    values: dict[str, float]
    half_widths: dict[str, float]
    vague: tuple[str, ...]  # parameters that the log does not tell
    correlated: tuple[str, str, float]  # the two that are hardest to tell apart
    rms_vy: float  # m/s
    rms_r: float  # rad/s
    windows: int
    additions: tuple[str, ...]


def cut(logs: Sequence[Log], seconds: float = WINDOW_S, every: float | None = None) -> Windows:
    """Return the windows of valid driving, one after the other or one `every` seconds.

    Raises BagError where there is none.
    """
    count, margin = round(seconds / STEP_S), round(LONGEST_DELAY_S / STEP_S)
    stride = count if every is None else round(every / STEP_S)
    parts = []
    for log in logs:
        usable = log.valid & (log.vx > LEAST_SPEED_MPS)
        for a, b in stretches(usable):
            for first in range(a + margin, b - count, stride):
                parts.append(window(log, first, first + count + 1))
    if not parts:
        raise BagError(
            f'{", ".join(log.name for log in logs)}: no {seconds:g} s of valid driving above '
            f'{LEAST_SPEED_MPS:g} m/s'
        )
    return Windows(*(np.concatenate(arrays, axis=1) for arrays in zip(*parts)))


def window(log: Log, begin: int, end: int) -> Windows:
    """Return the rows `begin` to `end` of a log, `end` not included, as one window."""
    first = begin - round(LONGEST_DELAY_S / STEP_S)
    columns = log.steer[first:end], *(getattr(log, n)[begin:end] for n in Windows._fields[1:])
    return Windows(*(column[:, None] for column in columns))


def axle_force(z: Any, stiffness: Any, capacity: Any) -> Any:
    """Return the lateral force of a Fiala axle [N] at the tangent of its slip angle."""
    q = np.minimum(np.abs(z) * stiffness / (3 * capacity), 1.0)
    return -np.sign(z) * capacity * (3 * q - 3 * q**2 + q**3)


class _Car:
    """Parameters of every column, arrays (columns,), and what follows from them."""

    def __init__(self, body: CarBody, drive_front_share: float, values: Mapping[str, Any]):
        self.p = {name: np.asarray(values.get(name, 0.0)) for name in KINDS}
        self.m, self.Izz, self.h = body.mass_kg, body.yaw_inertia_kgm2, body.cog_height_m
        self.L = body.cog_to_front_m + body.cog_to_rear_m
        self.lf = body.cog_to_front_m + self.p['cog_to_front_m']
        self.lr = self.L - self.lf
        self.drag, self.rolling = body.drag_n_per_mps2, body.rolling_n
        self.drive_front = drive_front_share

    def rates(self, vy, r, lagged, vx, ax, delta, roll_ay, fraction):
        """Return dvy/dt, dr/dt, ay and the steady slips of both axles.

        The slips that act have come from `lagged` nearer to these by a `fraction` of the way.
        """
        p = self.p
        Fx = self.m * ax + self.drag * vx**2 + self.rolling
        Fzf = (self.m * GRAVITY * self.lr - self.h * Fx) / self.L
        Fzr = (self.m * GRAVITY * self.lf + self.h * Fx) / self.L
        front = np.where(Fx > 0, self.drive_front, Fzf / (Fzf + Fzr))
        loss = (roll_ay / GRAVITY) ** 2
        axles = []
        for name, Fz, share in (('front', Fzf, front), ('rear', Fzr, 1 - front)):
            left = 1 - p[f'load_{name}'] * loss
            grip = p[f'{name}_friction'] * Fz * left
            along = np.clip(share * Fx, -LONGITUDINAL_SHARE * grip, LONGITUDINAL_SHARE * grip)
            axles.append((p[f'{name}_cornering_npr'] * left, np.sqrt(grip**2 - along**2), along))
        (Cf, Gf, Xf), (Cr, Gr, _) = axles
        angle = np.arctan((vy + self.lf * r) / vx)
        steady_f, turned = np.tan(angle - delta), delta
        if p['compliance_radpn'].any():
            for _ in range(3):
                turned = delta - p['compliance_radpn'] * axle_force(steady_f, Cf, Gf)
                steady_f = np.tan(angle - turned)
        zf = lagged[0] + (steady_f - lagged[0]) * fraction
        steady_r = (vy - self.lr * r) / vx
        zr = lagged[1] + (steady_r - lagged[1]) * fraction
        Ff, Fr = axle_force(zf, Cf, Gf), axle_force(zr, Cr, Gr)
        Yf = Ff * np.cos(turned) + Xf * np.sin(turned)
        ay = (Yf + Fr) / self.m
        return ay - vx * r, (self.lf * Yf - self.lr * Fr) / self.Izz, ay, (steady_f, steady_r)


def simulate(
    car: CarParams, values: Mapping[str, Any], windows: Windows, vy: np.ndarray, r: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vy, r and ay (rows, columns) from the states `vy` and `r` at the first row.

    `values` are numbers, or arrays with a value for each column of the windows.
    """
    single = _Car(car.car, car.actuators.drive_front_share, values)
    rows, columns = windows.vx.shape
    delta = delayed(windows.steer, single.p['steer_delay_s'], rows, columns)
    delta = delta + single.p['steer_offset_rad']
    ay = windows.ay[0]
    vx, ax = windows.vx, windows.ax
    # so that the axles have the slip of their steady state at the start
    lagged = single.rates(vy, r, (0.0, 0.0), vx[0], ax[0], delta[0], ay, 1.0)[3]
    roll_ay, out = ay, np.empty((3, rows, columns))
    relaxation = np.maximum(single.p['relaxation_m'], 1e-6)
    at_once = np.where(relaxation > 1e-6, 0.0, 1.0)
    rolled = 1 - np.exp(-STEP_S / ROLL_S)
    for k in range(rows - 1):
        middle = [(a[k] + a[k + 1]) / 2 for a in (vx, ax, delta)]
        half = 1 - np.exp(-middle[0] * STEP_S / 2 / relaxation)
        whole = 1 - np.exp(-middle[0] * STEP_S / relaxation)
        d_vy, d_r, ay, _ = single.rates(vy, r, lagged, vx[k], ax[k], delta[k], roll_ay, at_once)
        out[:, k] = vy, r, ay
        vy_m, r_m = vy + STEP_S / 2 * d_vy, r + STEP_S / 2 * d_r
        d_vy, d_r, ay, steady = single.rates(vy_m, r_m, lagged, *middle, roll_ay, half)
        lagged = tuple(old + (new - old) * whole for old, new in zip(lagged, steady))
        vy, r = vy + STEP_S * d_vy, r + STEP_S * d_r
        roll_ay = roll_ay + (ay - roll_ay) * rolled
    out[:, -1] = vy, r, ay
    return out[0], out[1], out[2]


def delayed(steer: np.ndarray, delay: Any, rows: int, columns: int) -> np.ndarray:
    """Return the steer of windows (rows, columns) `delay` seconds ago."""
    back = np.broadcast_to(delay / STEP_S, columns)
    whole = np.floor(back).astype(int)
    share = back - whole
    at = len(steer) - rows + np.arange(rows)[:, None] - whole
    column = np.broadcast_to(np.arange(columns), at.shape)
    return steer[at, column] * (1 - share) + steer[np.maximum(at - 1, 0), column] * share


def fit(
    logs: Sequence[Log],
    car: CarParams,
    additions: Sequence[str] = (),
    fixed: Mapping[str, float] | None = None,
) -> Fit:
    """Fit to the logs; `fixed` parameters keep their values. Raises BagError for too few windows.

    The additions are of ADDITIONS.
    """
    from scipy.optimize import least_squares

    windows = cut(logs)
    count = windows.vx.shape[1]
    if count < LEAST_WINDOWS:
        raise BagError(
            f'{count} windows of {WINDOW_S:g} s above {LEAST_SPEED_MPS:g} m/s; at least '
            f'{LEAST_WINDOWS} are needed'
        )
    if count > MOST_WINDOWS:  # those in which the car turns most
        windows = windows.take(np.sort(np.argsort(np.ptp(windows.r, axis=0))[-MOST_WINDOWS:]))
        count = MOST_WINDOWS
    fixed = dict(fixed or {})
    names = [*BASIC, *(name for word in additions for name in ADDITIONS[word])]
    names = [name for name in names if name not in fixed]
    low, high, scale, start = (np.array([KINDS[n][k] for n in names]) for k in range(4))
    problem = _Problem(car, windows, names, fixed, scale)
    stiff = np.isin(names, STIFFNESSES)
    start[stiff] = start[stiff] * car.car.mass_kg * GRAVITY / 2
    start = np.clip(start, low * 1.001, high * 0.999)
    x0 = np.concatenate([start / scale, windows.vy[0] / SCALE_VY_MPS, windows.r[0] / SCALE_R_RADPS])
    free = np.full(2 * count, np.inf)
    bounds = (np.append(low / scale, -free), np.append(high / scale, free))
    solution = least_squares(
        problem.residuals,
        x0,
        problem.jacobian,
        bounds,
        loss='soft_l1',
        xtol=1e-5,
        ftol=1e-6,
        max_nfev=MOST_STEPS,
    )
    values = dict(zip(names, (solution.x[: len(names)] * scale).tolist()))
    half_widths, correlation = problem.intervals(solution.x)
    half = dict(zip(names, (half_widths * scale).tolist()))
    vague = tuple(name for name in names if _is_vague(name, values[name], half[name]))
    pair = np.unravel_index(np.argmax(np.abs(np.triu(correlation, 1))), correlation.shape)
    residual = problem.residuals(solution.x).reshape(2, -1)
    rms = np.sqrt(np.mean(residual**2, axis=1))
    return Fit(
        fixed | values,
        half,
        vague,
        (names[pair[0]], names[pair[1]], float(correlation[pair])),
        float(rms[0] * SCALE_VY_MPS),
        float(rms[1] * SCALE_R_RADPS),
        count,
        tuple(additions),
    )


def _is_vague(name, value, half):
    kind = KINDS[name]
    at_bound = min(value - kind.low, kind.high - value) < 1e-3 * (kind.high - kind.low)
    reference = abs(value) if kind.relative else kind.high - kind.low
    # a delay, a length or a loss of nothing is an answer
    is_pushed = at_bound and (kind.low < 0 or value > kind.low + kind.scale)
    return is_pushed or half > VAGUE * reference


class _Problem:
    """Residuals of all windows and their derivatives by differences, every column at once."""

    def __init__(self, car, windows, names, fixed, scale):
        self.car, self.windows, self.names, self.fixed = car, windows, names, fixed
        self.scale, self.count = scale, windows.vx.shape[1]
        self.repeated = windows.take(np.tile(np.arange(self.count), len(names) + 3))

    def _split(self, x):
        n = len(self.names)
        return x[:n], x[n : n + self.count], x[n + self.count :]

    def _residual(self, theta, vy, r, windows):
        """Return (rows, 2, columns); `theta` (names, columns or 1)."""
        values = self.fixed | dict(zip(self.names, theta * self.scale[:, None]))
        model_vy, model_r, _ = simulate(
            self.car, values, windows, vy * SCALE_VY_MPS, r * SCALE_R_RADPS
        )
        measured = windows.vy - windows.vx * values.get('sideslip_offset_rad', 0.0)
        pair = (model_vy - measured) / SCALE_VY_MPS, (model_r - windows.r) / SCALE_R_RADPS
        return np.stack([part[::EVERY] for part in pair], axis=1)

    def residuals(self, x):
        """Return the residuals, those of vy first."""
        theta, vy, r = self._split(x)
        return self._residual(theta[:, None], vy, r, self.windows).transpose(1, 2, 0).ravel()

    def _derivatives(self, x, step=1e-4):
        """Return the residuals (windows, k), and their derivatives (windows, k, names + 2)."""
        theta, vy, r = self._split(x)
        n, count = len(self.names), self.count
        change = np.zeros((n + 3, n + 2))
        # inwards, away from the upper bound
        high = np.array([KINDS[name].high for name in self.names])
        signs = np.append(np.where(theta * self.scale > 0.9 * high, -1.0, 1.0), [1.0, 1.0])
        change[np.arange(1, n + 3), np.arange(n + 2)] = step * signs
        change = np.repeat(change, count, axis=0)
        result = self._residual(
            theta[:, None] + change[:, :n].T,
            np.tile(vy, n + 3) + change[:, n],
            np.tile(r, n + 3) + change[:, n + 1],
            self.repeated,
        )
        rows = result.reshape(-1, n + 3, count).transpose(2, 0, 1)
        return rows[:, :, 0], (rows[:, :, 1:] - rows[:, :, :1]) / (step * signs)

    def jacobian(self, x):
        """Return the derivatives of `residuals`, dense."""
        n, count = len(self.names), self.count
        _, D = self._derivatives(x)
        k = D.shape[1] // 2
        D = D.reshape(count, k, 2, n + 2).transpose(2, 0, 1, 3)  # vy or r, window, row, parameter
        J = np.zeros((2, count, k, n + 2 * count))
        J[..., :n] = D[..., :n]
        each = np.arange(count)
        J[:, each, :, n + each] = D[..., n].transpose(1, 0, 2)
        J[:, each, :, n + count + each] = D[..., n + 1].transpose(1, 0, 2)
        return J.reshape(-1, n + 2 * count)

    def intervals(self, x):
        """Return half widths (names,) in units of the scale, and the correlations.

        Of each window the part of the residuals that its free start explains is projected out; what
        is left is weighted as soft_l1 does it. The variance is that of a wild bootstrap, which
        turns the sign of a whole block of residuals at random, linear about the optimum.
        """
        from scipy.stats import t as student

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
