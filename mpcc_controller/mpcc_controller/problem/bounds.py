"""Limits of actuators, speed and friction per axle as bounds of every stage (paper, section 3.2).

The constrained quantities are those of `ocp.constraints`.
"""

import numpy as np

from mpcc_controller.model.single_track import Car, Input, State
from mpcc_controller.parameters import Limits
from mpcc_controller.problem.ocp import Constraints, total_friction_use
from stage_solver.stage_problem import Bounds

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
    sf = friction_share(limits, car, Fx, horizon, dt)
    ones = np.ones(horizon)
    per_axle = {'front': sf[:-1], 'rear': sf[:-1], 'total': sf[:-1]}
    g_high = Constraints(**per_axle, track=0 * ones, speed=free * ones)
    g_low = Constraints(
        **{name: -use for name, use in per_axle.items()},
        track=-free * ones,
        speed=limits.least_speed_mps * ones,
    )
    return Bounds(
        x_low=np.tile(x_low, (horizon + 1, 1)),
        x_high=np.tile(x_high, (horizon + 1, 1)),
        u_low=np.tile(u_low, (horizon, 1)),
        u_high=np.tile(u_high, (horizon, 1)),
        g_low=np.column_stack(g_low),
        g_high=np.column_stack(g_high),
        h_low=-sf[-1:],
        h_high=sf[-1:],
    )


def friction_share(limits: Limits, car: Car, Fx: float, horizon: int, dt: float) -> np.ndarray:
    """Return the share of the friction that each stage (N + 1,) may use.

    It is the paper's sf, or more where the rate limit keeps the force above it.
    """
    smallest = np.maximum(abs(Fx) - limits.force_rate_nps * dt * np.arange(horizon + 1), 0)
    required = np.abs(total_friction_use(np.copysign(smallest, Fx), car))
    return np.maximum(limits.friction_use, (1 + MARGIN) * required)
