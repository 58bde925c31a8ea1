"""What an optimal control problem is, stage by stage, and the plans that solve it.

    min  sum_{k<N} stage_cost(x_k, u_k, p_k) + terminal_cost(x_N, p_N)
    s.t. x_0 given,  x_{k+1} = dynamics(x_k, u_k, p_k)
         x_low_k <= x_k <= x_high_k (k = 1..N),  u_low_k <= u_k <= u_high_k
         g_low_k <= constraints(x_k, u_k, p_k) <= g_high_k,  h_low <= terminal(x_N, p_N) <= h_high

Everything here is in SI units; the scales of a problem are used by the solvers alone. No vehicle
is known here. The transcription is direct multiple shooting (Bock & Plitt 1984).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np


class ProblemError(ValueError):
    """A problem, or the numbers given for it, do not fit together."""


@dataclass(frozen=True)
class StageProblem:
    """A stage-wise optimal control problem; its functions take column vectors x, u, p in SI units.

    Raises ProblemError when a function does not have the sizes that the names promise.
    """

    name: str  # a C identifier
    states: tuple[str, ...]  # nx names
    inputs: tuple[str, ...]  # nu names
    parameters: tuple[str, ...]  # np names of the numbers that each stage is given
    horizon: int  # N intervals, N + 1 stages
    dynamics: ca.Function  # (x, u, p) -> next x, already discrete
    stage_cost: ca.Function  # (x, u, p) -> scalar, stages 0..N-1
    terminal_cost: ca.Function  # (x, p) -> scalar, stage N
    constraints: ca.Function  # (x, u, p) -> g, stages 0..N-1; may be empty
    terminal_constraints: ca.Function  # (x, p) -> h, stage N; may be empty
    scale_x: tuple[float, ...]  # SI units per solver unit of each state
    scale_u: tuple[float, ...]  # SI units per solver unit of each input

    def __post_init__(self):
        if not self.name.isidentifier():
            raise ProblemError(f'problem name {self.name!r} is not an identifier')
        if self.horizon < 1 or not self.states or not self.inputs:
            raise ProblemError(f'{self.name}: a stage, a state and an input are needed')
        nx, nu, n_p = len(self.states), len(self.inputs), len(self.parameters)
        _check_sizes(self.name, 'dynamics', self.dynamics, (nx, nu, n_p), nx)
        _check_sizes(self.name, 'stage_cost', self.stage_cost, (nx, nu, n_p), 1)
        _check_sizes(self.name, 'terminal_cost', self.terminal_cost, (nx, n_p), 1)
        _check_sizes(self.name, 'constraints', self.constraints, (nx, nu, n_p), self.ng)
        _check_sizes(
            self.name, 'terminal_constraints', self.terminal_constraints, (nx, n_p), self.nh
        )
        for names, scale in ((self.states, self.scale_x), (self.inputs, self.scale_u)):
            if len(scale) != len(names) or not all(0 < s < np.inf for s in scale):
                raise ProblemError(f'{self.name}: one positive scale each is needed for {names}')

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

    @property
    def ng(self) -> int:
        """Number of general constraints of a stage before the last."""
        return self.constraints.numel_out(0)

    @property
    def nh(self) -> int:
        """Number of general constraints of the last stage."""
        return self.terminal_constraints.numel_out(0)


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


class Multipliers(NamedTuple):
    """Lagrange multipliers: cost per unit of each limit, positive where an upper limit pushes."""

    x: np.ndarray  # (N + 1, nx) bounds of the states
    u: np.ndarray  # (N, nu) bounds of the inputs
    dynamics: np.ndarray  # (N, nx) of x_{k+1} - dynamics(x_k, u_k, p_k) = 0
    g: np.ndarray  # (N, ng)
    h: np.ndarray  # (nh,)


class Plan(NamedTuple):
    """States and inputs over the horizon, and the multipliers where a solver has found them."""

    X: np.ndarray  # (N + 1, nx)
    U: np.ndarray  # (N, nu)
    multipliers: Multipliers | None = None


def no_bounds(problem: StageProblem) -> Bounds:
    """Return bounds without any limit; `_replace` sets those that a problem has."""
    N = problem.horizon
    shapes = {
        'x': (N + 1, problem.nx),
        'u': (N, problem.nu),
        'g': (N, problem.ng),
        'h': (problem.nh,),
    }
    ends = {'low': -np.inf, 'high': np.inf}
    return Bounds(
        **{f'{kind}_{end}': np.full(shapes[kind], ends[end]) for kind in shapes for end in ends}
    )


def zero_plan(problem: StageProblem) -> Plan:
    """Return a plan of zeros, in SI units."""
    N = problem.horizon
    return Plan(np.zeros((N + 1, problem.nx)), np.zeros((N, problem.nu)))


def rk2(f: Callable[[Any, Any, Any], Any], dt: float) -> Callable[[Any, Any, Any], Any]:
    """Return the explicit midpoint step (Runge-Kutta 2) of x' = f(x, u, p) over dt seconds.

    f may work on CasADi symbols or on numpy arrays; u and p are held over the step. The local error
    is O(dt^3). For x' = -a x the step is stable while a dt < 2.
    """

    def step(x, u, p):
        return x + dt * f(x + dt / 2 * f(x, u, p), u, p)

    return step


def shift(plan: Plan, dynamics: ca.Function, p: np.ndarray) -> Plan:
    """Return the plan one stage later: the first guess of the next solve.

    Stage 0 is dropped, the last input is repeated and the last state is integrated with `dynamics`
    under it and the stage parameters `p` (np,). Multipliers move with their stages.
    """
    u_last = plan.U[-1]
    x_end = dynamics(plan.X[-1], u_last, p).full().ravel()
    X = np.vstack([plan.X[1:], x_end])
    U = np.vstack([plan.U[1:], u_last])
    if plan.multipliers is None:
        return Plan(X, U)
    old = plan.multipliers
    moved = {n: np.vstack([v[1:], v[-1:]]) for n, v in old._asdict().items() if n != 'h'}
    return Plan(X, U, Multipliers(**moved, h=old.h))


def _check_sizes(name, role, function, sizes_in, size_out):
    given = tuple(function.size_in(i) for i in range(function.n_in()))
    wanted = tuple((n, 1) for n in sizes_in)
    if [s[0] * s[1] for s in given] != list(sizes_in):
        raise ProblemError(f'{name}: {role} takes arguments of sizes {given}, not {wanted}')
    if function.n_out() != 1 or function.numel_out(0) != size_out:
        raise ProblemError(f'{name}: {role} must return one vector of {size_out}')
