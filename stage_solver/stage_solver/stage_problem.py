"""Optimal control problems in stages, their bounds, and plans over their horizon.

    min  sum_{k<N} stage_cost(x_k, u_k, p_k) + terminal_cost(x_N, p_N)
    s.t. x_0 given,  x_{k+1} = dynamics(x_k, u_k, p_k)
         x_low_k <= x_k <= x_high_k (k = 1..N),  u_low_k <= u_k <= u_high_k
         g_low_k <= constraints(x_k, u_k, p_k) <= g_high_k
         h_low <= terminal_constraints(x_N, p_N) <= h_high

All arrays are in SI units; only the solvers use the scales of a problem. The transcription is
direct multiple shooting (Bock & Plitt 1984).
"""

import dataclasses
import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

# results kept per function of a problem: a process that simulates cars in turn has a few problems
MAX_CACHED_PROBLEMS = 8


class ProblemError(ValueError):
    """A problem contradicts itself, or arrays given with it have the wrong shape."""


@dataclass(frozen=True, eq=False)
class StageProblem:
    """A stage-wise optimal control problem; its functions take column vectors x, u, p in SI units.

    Problems with equal content are equal and have equal hashes. Raises ProblemError when a function
    does not have the sizes that the names imply.
    """

    name: str  # a C identifier
    states: tuple[str, ...]  # nx names
    inputs: tuple[str, ...]  # nu names
    parameters: tuple[str, ...]  # np names of the parameters of one stage
    horizon: int  # N intervals, N + 1 stages
    dynamics: ca.Function  # (x, u, p) -> next x, discrete time
    stage_cost: ca.Function  # (x, u, p) -> scalar, stages 0..N-1
    terminal_cost: ca.Function | None = None  # (x, p) -> scalar, stage N; None: no cost
    constraints: ca.Function | None = None  # (x, u, p) -> g, stages 0..N-1; None: no constraint
    terminal_constraints: ca.Function | None = None  # (x, p) -> h, stage N; None: no constraint
    scale_x: tuple[float, ...] | None = None  # SI units per solver unit of each state; None: 1
    scale_u: tuple[float, ...] | None = None  # SI units per solver unit of each input; None: 1

    def __post_init__(self):
        if not self.name.isidentifier():
            raise ProblemError(f'problem name {self.name!r} is not an identifier')
        if self.horizon < 1 or not self.states or not self.inputs:
            raise ProblemError(f'{self.name}: a stage, a state and an input are needed')
        x, u, p = (ca.SX.sym(*name) for name in (('x', self.nx), ('u', self.nu), ('p', self.np)))
        defaults = {
            'terminal_cost': ca.Function('terminal_cost', [x, p], [ca.SX(0)]),
            'constraints': ca.Function('constraints', [x, u, p], [ca.SX(0, 1)]),
            'terminal_constraints': ca.Function('terminal_constraints', [x, p], [ca.SX(0, 1)]),
            'scale_x': (1.0,) * self.nx,
            'scale_u': (1.0,) * self.nu,
        }
        for field, default in defaults.items():
            if getattr(self, field) is None:
                object.__setattr__(self, field, default)
        before_last, last = (self.nx, self.nu, self.np), (self.nx, self.np)
        self._check_sizes('dynamics', before_last, self.nx)
        self._check_sizes('stage_cost', before_last, 1)
        self._check_sizes('terminal_cost', last, 1)
        self._check_sizes('constraints', before_last, self.ng)
        self._check_sizes('terminal_constraints', last, self.nh)
        for names, scale in ((self.states, self.scale_x), (self.inputs, self.scale_u)):
            if len(scale) != len(names) or not all(0 < s < np.inf for s in scale):
                raise ProblemError(f'{self.name}: one positive scale each is needed for {names}')

    def __eq__(self, other):
        return isinstance(other, StageProblem) and self.digest == other.digest

    def __hash__(self):
        return hash(self.digest)

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the names, sizes, scales and serialized functions."""
        values = [getattr(self, field.name) for field in dataclasses.fields(self)]
        plain = [v.serialize() if isinstance(v, ca.Function) else v for v in values]
        return hashlib.sha256(repr(plain).encode()).hexdigest()

    @property
    def nx(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def nu(self) -> int:
        """Number of inputs."""
        return len(self.inputs)

    @property
    def np(self) -> int:
        """Number of parameters of one stage."""
        return len(self.parameters)

    @cached_property
    def ng(self) -> int:
        """Number of general constraints of a stage before the last."""
        return self.constraints.numel_out(0)

    @cached_property
    def nh(self) -> int:
        """Number of general constraints of the last stage."""
        return self.terminal_constraints.numel_out(0)

    @cached_property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Shapes of x0, P, the bounds, X and U of a plan, and its multipliers as m_<name>."""
        N, nx, nu = self.horizon, self.nx, self.nu
        limited = {'x': (N + 1, nx), 'u': (N, nu), 'g': (N, self.ng), 'h': (self.nh,)}
        shapes = {'x0': (nx,), 'P': (N + 1, self.np), 'X': limited['x'], 'U': limited['u']}
        shapes |= {f'{x}_{end}': limited[x] for x in limited for end in ('low', 'high')}
        return shapes | {f'm_{x}': limited[x] for x in limited} | {'m_dynamics': (N, nx)}

    def _check_sizes(self, field, sizes_in, size_out):
        function = getattr(self, field)
        given = tuple(function.size_in(i) for i in range(function.n_in()))
        needed = tuple((n, 1) for n in sizes_in)
        if [rows * columns for rows, columns in given] != list(sizes_in):
            raise ProblemError(
                f'{self.name}: {field} takes arguments of sizes {given}, not {needed}'
            )
        if function.n_out() != 1 or function.numel_out(0) != size_out:
            raise ProblemError(f'{self.name}: {field} must return one vector of {size_out}')


def _shapes_repr(arrays: NamedTuple) -> str:
    """Return the shape of every array instead of its numbers."""
    shapes = (f'{n}: {np.shape(a)}' for n, a in arrays._asdict().items() if a is not None)
    return f'{type(arrays).__name__}({", ".join(shapes)})'


class Bounds(NamedTuple):
    """Limits of every stage, infinite where there is none; row 0 of x_low, x_high is not used."""

    x_low: np.ndarray  # (N + 1, nx)
    x_high: np.ndarray
    u_low: np.ndarray  # (N, nu)
    u_high: np.ndarray
    g_low: np.ndarray  # (N, ng)
    g_high: np.ndarray
    h_low: np.ndarray  # (nh,)
    h_high: np.ndarray

    __repr__ = _shapes_repr


class Multipliers(NamedTuple):
    """Lagrange multipliers in cost per SI unit of each limit; positive at an active upper limit."""

    x: np.ndarray  # (N + 1, nx) bounds of the states
    u: np.ndarray  # (N, nu) bounds of the inputs
    dynamics: np.ndarray  # (N, nx) of x_{k+1} - dynamics(x_k, u_k, p_k) = 0
    g: np.ndarray  # (N, ng)
    h: np.ndarray  # (nh,)

    __repr__ = _shapes_repr


class Plan(NamedTuple):
    """States and inputs over the horizon, and the multipliers where a solver has computed them."""

    X: np.ndarray  # (N + 1, nx)
    U: np.ndarray  # (N, nu)
    multipliers: Multipliers | None = None

    def __repr__(self):
        suffix = '' if self.multipliers is None else ', with multipliers'
        return f'Plan(X: {np.shape(self.X)}, U: {np.shape(self.U)}{suffix})'


def no_bounds(problem: StageProblem) -> Bounds:
    """Return infinite bounds; assign the finite limits of a problem to their elements."""
    limits = {'low': -np.inf, 'high': np.inf}
    return Bounds(*(np.full(problem.shapes[n], limits[n[2:]]) for n in Bounds._fields))


def zero_plan(problem: StageProblem) -> Plan:
    """Return a plan of zeros, in SI units."""
    return Plan(np.zeros(problem.shapes['X']), np.zeros(problem.shapes['U']))


def rk2(f: Callable[[Any, Any, Any], Any], dt: float) -> Callable[[Any, Any, Any], Any]:
    """Return the explicit midpoint step (Runge-Kutta 2) of x' = f(x, u, p) over dt seconds.

    f may work on CasADi symbols or on numpy arrays; u and p are held over the step. The local error
    is O(dt^3). For x' = -a x the step is stable while a dt < 2.
    """

    def step(x, u, p):
        return x + dt * f(x + dt / 2 * f(x, u, p), u, p)

    return step


def shift(plan: Plan, dynamics: Callable, p: np.ndarray) -> Plan:
    """Return the plan one stage later: the initial guess of the next solve.

    Stage 0 is dropped, the last input is repeated and the last state is integrated with `dynamics`,
    (x, u, p) -> the next state, under it and the stage parameters `p` (np,). Multipliers move with
    their stages.
    """
    u_last = plan.U[-1]
    x_end = np.asarray(dynamics(plan.X[-1], u_last, p), float).ravel()
    X, U, old = _shift_rows(plan.X, x_end), _shift_rows(plan.U, u_last), plan.multipliers
    if old is None:
        return Plan(X, U)
    shifted = (_shift_rows(rows, rows[-1]) for rows in (old.x, old.u, old.dynamics, old.g))
    return Plan(X, U, Multipliers(*shifted, old.h))


def _shift_rows(rows, last):
    """Return rows without the first one and with `last` at the end."""
    shifted = np.empty_like(rows)
    shifted[:-1], shifted[-1] = rows[1:], last
    return shifted


# checks of the arguments of a solve: solvers may hang or crash on values that are not finite


def check_shapes(
    problem: StageProblem, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan
) -> None:
    """Raise ProblemError for the first argument whose shape does not fit the problem."""
    arrays = {'x0': x0, 'P': P} | bounds._asdict() | {'guess.X': guess.X, 'guess.U': guess.U}
    for name, array in arrays.items():
        shape = problem.shapes[name.removeprefix('guess.')]
        if np.shape(array) != shape:
            raise ProblemError(f'{name} has shape {np.shape(array)}; {shape} is needed')


def find_invalid_argument(
    problem: StageProblem, x0: np.ndarray, P: np.ndarray, bounds: Bounds, guess: Plan
) -> str:
    """Return a message about the first invalid value in the arguments of a solve, '' if none."""
    arguments = (
        ('the initial state', x0[None, :], problem.states),
        ('the parameters', P, problem.parameters),
        ('the guess', guess.X[1:], problem.states),
        ('the guess', guess.U, problem.inputs),
    )
    for label, array, names in arguments:
        bad = np.argwhere(~np.isfinite(array))
        if bad.size:
            stage, i = bad[0]
            return f'{label} is not finite: {names[i]} = {array[stage, i]}, row {stage}'
    for kind in ('x', 'u', 'g', 'h'):
        low, high = getattr(bounds, f'{kind}_low'), getattr(bounds, f'{kind}_high')
        if kind == 'x':
            low, high = low[1:], high[1:]
        # NaN fails every comparison, so the negation finds it too
        bad = np.argwhere(~((low <= high) & (low < np.inf) & (high > -np.inf)))
        if bad.size:
            at = tuple(bad[0])
            return f'no value of {kind}{list(map(int, at))} lies in [{low[at]}, {high[at]}]'
    return ''
