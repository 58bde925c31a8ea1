"""Limits of actuators, speed and friction per axle as bounds of every stage (paper, section 3.2).

The constrained quantities are those of `ocp.constraints`; the row of the road edges is in
`constraints` of a formulation (`mpcc_formulation.py`, `frenet_formulation.py`).
"""

from functools import lru_cache

import numpy as np

from mpcc_controller.model import single_track
from mpcc_controller.model.single_track import Car, Input, State
from mpcc_controller.parameters import Limits
from stage_solver.stage_problem import Bounds

AXLES = 2  # front and rear: the first rows of g, shares of their friction
KEPT = 64  # sets of limits: with lost brakes they change with the friction that is believed
MARGIN = 1e-3  # relative, between a state that cannot be changed and its bound


def build(
    limits: Limits,
    car: Car,
    x0: State,
    horizon: int,
    dt: float,
    state: type = State,
    circles: int = 1,
) -> Bounds:
    """Return the bounds for a plan that starts with the angle and the total force of `x0`.

    `state` is the NamedTuple of the formulation's states; delta and Fx are bounded. `circles` of
    the vehicle are kept on the track.

    Where one already exceeds its bound, or the force its share of the friction (the limit was
    lowered, or the friction dropped, while the car braked), the bounds widen to what its rate limit
    allows to reach: a state that cannot be changed must not make the problem infeasible.
    """
    driving, braking = friction_shares(limits, car, x0.Fx, horizon, dt)
    constant = _without_friction(limits, horizon, state, circles)
    reach = dt * np.arange(horizon + 1)
    for name, rate in (('delta', limits.steer_rate_radps), ('Fx', limits.force_rate_nps)):
        i, value = state._fields.index(name), getattr(x0, name)
        low, high = constant.x_low[:, i], constant.x_high[:, i]
        if not (1 + MARGIN) * low[0] <= value <= (1 + MARGIN) * high[0]:
            farthest = (1 + MARGIN) * abs(value) - rate * reach
            constant = constant._replace(
                x_low=np.array(constant.x_low), x_high=np.array(constant.x_high)
            )
            constant.x_low[:, i] = np.minimum(low, -farthest if value < 0 else low)
            constant.x_high[:, i] = np.maximum(high, farthest if value > 0 else high)
    g_high, g_low = constant.g_high.copy(), constant.g_low.copy()
    g_high[:, :AXLES], g_low[:, :AXLES] = driving[:AXLES, :-1].T, -braking[:AXLES, :-1].T
    return constant._replace(
        g_low=g_low, g_high=g_high, h_low=-braking[AXLES, -1:], h_high=driving[AXLES, -1:]
    )


@lru_cache(KEPT)
def _without_friction(limits, horizon, state, circles) -> Bounds:
    """Return the bounds that are equal at all times, as arrays that cannot be changed."""
    free = np.inf

    def states(sign, Fx):
        fields = dict.fromkeys(state._fields, sign * free)
        return state(**fields | {'delta': sign * limits.steer_rad, 'Fx': Fx})

    def inputs(sign, split):
        rates = sign * limits.steer_rate_radps, sign * limits.force_rate_nps
        return Input(*rates, lambda_b=split, slack=sign * free)

    ends = Bounds(
        x_low=states(-1, -limits.brake_n),
        x_high=states(1, limits.drive_n),
        u_low=inputs(-1, limits.brake_front_share_min),
        u_high=inputs(1, limits.brake_front_share_max),
        g_low=(AXLES + circles) * (-free,),
        g_high=(*AXLES * (free,), *circles * (0.0,)),
        h_low=(-free,),
        h_high=(free,),
    )
    rows = {'x': (horizon + 1, 1), 'u': (horizon, 1), 'g': (horizon, 1), 'h': 1}
    arrays = {name: np.tile(end, rows[name[0]]) for name, end in ends._asdict().items()}
    for array in arrays.values():
        array.flags.writeable = False
    return Bounds(**arrays)


def friction_shares(
    limits: Limits, car: Car, Fx: float, horizon: int, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the shares of the friction that each stage may use to drive and to brake.

    Each is (3, N + 1): of the front axle, of the rear axle, of both. They are those of `limits`, or
    more where the rate limit keeps the force above them: what an axle needs for the smallest force
    that can be reached. A driving force is shared between the axles as the car does, a braking
    force as their friction is, within the limits of lambda_b.
    """
    smallest = np.maximum(abs(Fx) - limits.force_rate_nps * dt * np.arange(horizon + 1), 0)
    Fz = single_track.loads(np.copysign(smallest, Fx), car)
    front, rear = car.mu_f * Fz.f, car.mu_r * Fz.r
    lambda_b = np.clip(
        front / (front + rear), limits.brake_front_share_min, limits.brake_front_share_max
    )
    at_front = lambda_b if Fx < 0 else car.lambda_d
    needed = (at_front * smallest / front, (1 - at_front) * smallest / rear)
    needed = (1 + MARGIN) * np.array((*needed, smallest / (front + rear)))
    drive_use = limits.drive_friction_use
    drive_use = limits.friction_use if drive_use is None else drive_use
    return (
        np.maximum(drive_use, needed * (Fx > 0)),
        np.maximum(limits.friction_use, needed * (Fx < 0)),
    )
