"""Limits of actuators, speed and friction per axle as bounds of every stage (paper, section 3.2).

The constrained quantities are those of `ocp.constraints`.
"""

from functools import cache

import numpy as np

from mpcc_controller.model.single_track import Car, Input, State
from mpcc_controller.parameters import Limits
from mpcc_controller.problem.ocp import Constraints, total_friction_use
from stage_solver.stage_problem import Bounds

FRICTION = ('front', 'rear', 'total')  # the rows of g that are shares of the friction
MARGIN = 1e-3  # relative, between a state that cannot be changed and its bound


def build(
    limits: Limits, car: Car, Fx: float, horizon: int, dt: float, state: type = State
) -> Bounds:
    """Return the bounds for a plan that starts with the total force `Fx` [N].

    `state` is the NamedTuple of the formulation's states; delta and Fx are bounded.

    Where the force already exceeds its share of the friction (the friction dropped, or after a
    restart), the friction bounds widen to what the rate limit of the force allows to reach: a state
    that cannot be changed must not make the problem infeasible.
    """
    sf = friction_share(limits, car, Fx, horizon, dt)
    constant = _without_friction(limits, horizon, state)
    g_high, g_low = constant.g_high.copy(), constant.g_low.copy()
    for name in FRICTION:
        g_high[:, Constraints._fields.index(name)] = sf[:-1]
        g_low[:, Constraints._fields.index(name)] = -sf[:-1]
    return constant._replace(g_low=g_low, g_high=g_high, h_low=-sf[-1:], h_high=sf[-1:])


@cache
def _without_friction(limits, horizon, state) -> Bounds:
    """Return the bounds that are equal at all times, as arrays that cannot be changed."""
    free = np.inf
    x_high = state(
        **dict.fromkeys(state._fields, free) | {'delta': limits.steer_rad, 'Fx': limits.drive_n}
    )
    x_low = state(
        **dict.fromkeys(state._fields, -free) | {'delta': -limits.steer_rad, 'Fx': -limits.brake_n}
    )
    u_high = Input(
        d_delta=limits.steer_rate_radps,
        d_Fx=limits.force_rate_nps,
        lambda_b=limits.brake_front_share_max,
        slack=free,
    )
    u_low = u_high._replace(
        d_delta=-limits.steer_rate_radps,
        d_Fx=-limits.force_rate_nps,
        lambda_b=limits.brake_front_share_min,
        slack=-free,
    )
    friction = dict.fromkeys(FRICTION, free)
    g_high = Constraints(**friction, track=0.0, speed=free)
    g_low = Constraints(**friction, track=-free, speed=limits.least_speed_mps)
    rows = {'x': horizon + 1, 'u': horizon, 'g': horizon, 'h': 1}
    limit = {'x': (x_low, x_high), 'u': (u_low, u_high), 'g': (g_low, g_high), 'h': (-free, free)}
    arrays = {
        f'{kind}_{end}': np.tile(values, rows[kind] if kind == 'h' else (rows[kind], 1))
        for kind, ends in limit.items()
        for end, values in zip(('low', 'high'), ends)
    }
    for array in arrays.values():
        array.flags.writeable = False
    return Bounds(**arrays)


def friction_share(limits: Limits, car: Car, Fx: float, horizon: int, dt: float) -> np.ndarray:
    """Return the share of the friction that each stage (N + 1,) may use.

    It is the paper's sf, or more where the rate limit keeps the force above it.
    """
    smallest = np.maximum(abs(Fx) - limits.force_rate_nps * dt * np.arange(horizon + 1), 0)
    required = np.abs(total_friction_use(np.copysign(smallest, Fx), car))
    return np.maximum(limits.friction_use, (1 + MARGIN) * required)
