"""Non-linear single track: the prediction model of the paper, eq. 1 and 2. SI units, ISO 8855.

The names are the paper's. Two corrections to the printed equations: X' = vx cos psi - vy sin psi
(the paper prints a plus), and the axle loads follow the longitudinal force quasi-statically, as
the ideal brake split of the paper requires.
"""

from collections import namedtuple
from collections.abc import Iterable
from functools import cache
from typing import Any, NamedTuple

import casadi as ca

from mpcc_controller.model import fiala
from stage_solver.stage_problem import rk2

GRAVITY = 9.81  # m/s^2
SLIP_SPEED_ROUNDING = 0.25  # (m/s)^2; 4 mm/s at 20 m/s for a least speed of 5 m/s
# rad; beyond it, a wheel that is dragged sideways, the tangent has a pole where the force stays
MAX_SLIP = 1.3
STANDSTILL_ROUNDING = 1e-6  # (m/s)^2; |v| has no derivative at rest


class State(NamedTuple):
    """State x of the prediction model."""

    X: Any  # m, map
    Y: Any  # m, map
    psi: Any  # rad, map
    vx: Any  # m/s, body
    vy: Any  # m/s, body
    r: Any  # rad/s
    theta: Any  # m, travelled distance
    delta: Any  # rad, road-wheel angle
    Fx: Any  # N, total longitudinal force


class Input(NamedTuple):
    """Input u: the three of the paper, and the slack that keeps the problem feasible."""

    d_delta: Any  # rad/s
    d_Fx: Any  # N/s
    lambda_b: Any  # -, front share of the braking force
    slack: Any  # m beyond the road edge


class Car(NamedTuple):
    """Parameters of the vehicle and its tyres; mu_* include the believed friction of the road."""

    m: Any  # kg
    Izz: Any  # kg m^2
    l_f: Any  # m, CoG to front axle
    l_r: Any  # m, CoG to rear axle
    h: Any  # m, CoG above the road
    drag: Any  # N/(m/s)^2
    rolling: Any  # N
    lambda_d: Any  # -, front share of the driving force (0: rear-wheel drive)
    C_f: Any  # N/rad, cornering stiffness of the front axle
    C_r: Any  # N/rad
    mu_f: Any  # -
    mu_r: Any  # -
    tyre_switch: Any  # -, where the tangent continues the Fiala curve
    v_slip: Any  # m/s, least speed in the slip angles
    force_blend: Any  # N, width of the change from braking to driving
    # beyond the paper, each left out of the equations where it is the number 0: how far the
    # actuators are behind set-points that move at constant rates, the speed up to which the
    # car is a kinematic single track, below the tyre dynamics, and how far the front wheels give
    # way to their lateral force
    steer_lag: Any = 0.0  # s
    force_lag: Any = 0.0  # s
    kinematic_below: Any = 0.0  # m/s
    compliance: Any = 0.0  # rad/N


EXTENSIONS = tuple(Car._field_defaults)


def structure(car: Car) -> Car:
    """Return the names of the parameters in place of their values; 0 where an extension is off."""
    values = car._asdict().items()
    return Car(*(0.0 if name in EXTENSIONS and _is_off(v) else name for name, v in values))


def _is_off(value):
    return isinstance(value, int | float) and value == 0


PAPER = structure(Car(*Car._fields[: -len(EXTENSIONS)]))


def car_of(structure: Car, values: Iterable) -> Car:
    """Return the car of these parameters, in which 0 stays where the structure has it."""
    return Car(*(value if name else 0.0 for name, value in zip(structure, values, strict=True)))


def car_symbols(structure: Car) -> tuple[ca.SX, Car]:
    """Return symbols (len(Car),) of all parameters, and the car made of them."""
    flat = ca.SX.sym('car', len(structure))
    return flat, car_of(structure, ca.vertsplit(flat))


# m/s, up to which a car is kinematic at least: from there on the slip angles have the true speed
BLEND_FROM_MPS = 5.0
BLEND_MPS = 3.0  # over which the kinematic model changes to the dynamic one
SETTLING_S = 0.1  # in which the lateral motion takes up that of the kinematic model
LEAST_GRIP = 0.01  # share of the friction that braking leaves to steering at least
ROLLING_MPS = 0.3  # below it the resistances fade out: they do not push a standing car back
CREEP_MPS = 0.1  # below it the travelled distance of the kinematic model is rounded


class Axles(NamedTuple):
    """One quantity per axle."""

    f: Any
    r: Any


class BodyRates(NamedTuple):
    """Rates of the velocities of the body."""

    vx: Any  # m/s^2, of the component: centripetal acceleration included
    vy: Any  # m/s^2
    r: Any  # rad/s^2


class TyreForces(NamedTuple):
    """Forces in the wheel frames [N]; `F_yf` and `F_yr` are positive to the left."""

    F_xf: Any
    F_xr: Any
    F_yf: Any
    F_yr: Any


def loads(Fx, car):
    """Return the axle loads [N] while `Fx` [N] accelerates the car (quasi-static)."""
    wheelbase = car.l_f + car.l_r
    weight = car.m * GRAVITY
    return Axles(
        f=(weight * car.l_r - car.h * Fx) / wheelbase,
        r=(weight * car.l_f + car.h * Fx) / wheelbase,
    )


def ideal_split(Fx, car):
    """Return the brake split at which both axles lock together; the paper's ratio simplifies."""
    Fz = loads(Fx, car)
    return Fz.f / (Fz.f + Fz.r)


def split(Fx, lambda_b, car):
    """Return the longitudinal force [N] per axle as the paper's eq. 2 demands it.

    The two cases are written with min and max: equal to the printed if, without the branch.
    """
    brake, drive = ca.fmin(Fx, 0), ca.fmax(Fx, 0)
    return Axles(
        f=lambda_b * brake + car.lambda_d * drive,
        r=(1 - lambda_b) * brake + (1 - car.lambda_d) * drive,
    )


def smooth_split(Fx, lambda_b, car):
    """Return `split` without its corner at Fx = 0, for the optimiser.

    A plan that passes from braking to driving in a bend often has its optimal force exactly at that
    corner, where no gradient vanishes and the solver iterates to its limit. The share
    of the front axle changes from lambda_b to lambda_d within some `force_blend`; the axles share
    the sign of Fx, and their sum is Fx.
    """
    driving = (1 + ca.tanh(Fx / car.force_blend)) / 2
    front = lambda_b + (car.lambda_d - lambda_b) * driving
    return Axles(f=front * Fx, r=(1 - front) * Fx)


def slips(x, car):
    """Return tan(alpha) per axle, in front before the wheels give way.

    Below `v_slip` the speed in the denominator is bounded smoothly: RK2 at 50 ms is unstable on the
    tyre dynamics near 5 m/s, and an iterate of the solver may have any speed.
    """
    v = _bounded_speed(x, car)
    front = ca.atan((x.vy + car.l_f * x.r) / v) - x.delta
    if not _is_off(car.kinematic_below):
        front = ca.fmin(ca.fmax(front, -MAX_SLIP), MAX_SLIP)
    return Axles(
        f=ca.tan(front),
        r=(x.vy - car.l_r * x.r) / v,
    )


def _bounded_speed(x, car):
    faster = x.vx - car.v_slip
    return car.v_slip + (faster + ca.sqrt(faster**2 + SLIP_SPEED_ROUNDING)) / 2


def sliding_slips(car: Car) -> Axles:
    """Return the slip angle [rad] per axle at which the tyre slides fully, Fx = 0.

    There the lateral force of the Fiala tyre is the friction: tan(alpha) = 3 mu Fz / C. That of
    the front axle is, as in `slips`, the angle before the wheels give way.
    """
    Fz = loads(0.0, car)
    given = 0.0 if _is_off(car.compliance) else car.compliance * car.mu_f * Fz.f
    return Axles(
        f=ca.atan(3 * car.mu_f * Fz.f / car.C_f + given),
        r=ca.atan(3 * car.mu_r * Fz.r / car.C_r),
    )


def greatest_yaw_rate(x, car: Car):
    """Return the yaw rate [rad/s] that the friction of both axles keeps steady, mu g / vx.

    The speed is bounded as in `slips`.
    """
    Fz = loads(0.0, car)
    return (car.mu_f * Fz.f + car.mu_r * Fz.r) / (car.m * _bounded_speed(x, car))


def tyre_forces(x, u, car):
    """Return the forces of both axles, each inside its friction circle."""
    Fz = loads(x.Fx, car)
    demand = smooth_split(x.Fx, u.lambda_b, car)
    tan_alpha = slips(x, car)
    F_xf = fiala.longitudinal_force(demand.f, Fz.f, car.mu_f)
    F_xr = fiala.longitudinal_force(demand.r, Fz.r, car.mu_r)
    front = fiala.lateral_capacity(F_xf, Fz.f, car.mu_f)
    rear = fiala.lateral_capacity(F_xr, Fz.r, car.mu_r)
    slip = tan_alpha.f
    if not _is_off(car.compliance):
        slip = fiala.remaining_slip(slip, front, car.C_f, car.tyre_switch, car.compliance)
    return TyreForces(
        F_xf=F_xf,
        F_xr=F_xr,
        F_yf=fiala.lateral_force(slip, front, car.C_f, car.tyre_switch),
        F_yr=fiala.lateral_force(tan_alpha.r, rear, car.C_r, car.tyre_switch),
    )


def acting(x, u: Input, car: Car):
    """Return the state with the angle and the force that act instead of their set-points.

    A linear servo of any order follows a ramp by a constant time behind it, 2 zeta / omega if it
    is of second order, once its transient is over. So within a step, where set-points move at
    constant rates, delta - lag d_delta acts. Exact for rates that last, without a state.
    """
    if not _is_off(car.steer_lag):
        x = x._replace(delta=x.delta - car.steer_lag * u.d_delta)
    return x if _is_off(car.force_lag) else x._replace(Fx=x.Fx - car.force_lag * u.d_Fx)


def body_rates(x, u: Input, car: Car) -> BodyRates:
    """Return the rates of the body velocities (paper, eq. 1), by what acts.

    `x` needs vx, vy, r, delta and Fx only: the coordinates of the position do not matter. A slow
    car moves by `kinematic_rates` where the model has them.
    """
    x = acting(x, u, car)
    dynamic = dynamic_rates(x, u, car)
    if _is_off(car.kinematic_below):
        return dynamic
    slow, share = kinematic_rates(x, u, car), dynamic_share(x, car)
    return BodyRates(*(share * d + (1 - share) * k for d, k in zip(dynamic, slow)))


def dynamic_share(x, car):
    """Return the share of the dynamic model: 0 up to `kinematic_below`, 1 from BLEND_MPS more on.

    The quintic between them has two continuous derivatives, as exact Hessians need. Sideways
    motion counts: a car that slides is not kinematic.
    """
    speed = ca.sqrt(x.vx**2 + x.vy**2 + STANDSTILL_ROUNDING)
    t = ca.fmin(ca.fmax((speed - car.kinematic_below) / BLEND_MPS, 0), 1)
    return t**3 * (10 - 15 * t + 6 * t**2)


def kinematic_rates(x, u: Input, car) -> BodyRates:
    """Return the rates of the kinematic single track (Kong et al. 2015), which rolls without slip.

    There r = vx tan(delta) / L and vy = l_r r: the centre of the rear axle does not move sideways.
    The lateral motion follows these at their own rates and takes them up within SETTLING_S. Blends
    of both models: Polack et al. 2017.

    A car that brakes with all of its friction does not follow its steering: the yaw rate is `held`
    below what the friction of both axles leaves beside `Fx`, LEAST_GRIP of it at least.
    """
    wheelbase = car.l_f + car.l_r
    F = smooth_split(x.Fx, u.lambda_b, car)
    rolling = ca.tanh(x.vx / ROLLING_MPS)
    F_drag = (car.drag * x.vx**2 + car.rolling) * rolling
    tan_delta = ca.tan(x.delta)
    vx_rate = (F.f * ca.cos(x.delta) + F.r - F_drag) / car.m
    ay = x.vx**2 * tan_delta / wheelbase
    Fz = loads(0.0, car)
    grip = car.mu_f * Fz.f + car.mu_r * Fz.r
    greatest_ay = ca.sqrt(ca.fmax(grip**2 - x.Fx**2, 0) + (LEAST_GRIP * grip) ** 2) / car.m
    held = (1 + (ay / greatest_ay) ** 4) ** -0.25
    r = held * x.vx * tan_delta / wheelbase
    r_rate = held * (vx_rate * tan_delta + x.vx * (1 + tan_delta**2) * u.d_delta) / wheelbase
    return BodyRates(
        vx=vx_rate,
        vy=car.l_r * r_rate + (car.l_r * r - x.vy) / SETTLING_S,
        r=r_rate + (r - x.r) / SETTLING_S,
    )


def dynamic_rates(x, u: Input, car) -> BodyRates:
    """Return the rates of the body by the forces of the tyres (paper, eq. 1)."""
    F = tyre_forces(x, u, car)
    F_drag = car.drag * x.vx**2 + car.rolling
    delta = x.delta if _is_off(car.compliance) else x.delta - car.compliance * F.F_yf
    sin_delta, cos_delta = ca.sin(delta), ca.cos(delta)
    front_x = F.F_xf * cos_delta - F.F_yf * sin_delta  # front axle force in the body frame, N
    front_y = F.F_xf * sin_delta + F.F_yf * cos_delta
    return BodyRates(
        vx=(front_x + F.F_xr - F_drag) / car.m + x.r * x.vy,
        vy=(front_y + F.F_yr) / car.m - x.r * x.vx,
        r=(car.l_f * front_y - car.l_r * F.F_yr) / car.Izz,
    )


def lateral_jerk(x, u: Input, car: Car):
    """Return the rate of the lateral acceleration ay = vy' + r vx [m/s^3] at constant inputs."""
    names = ('vx', 'vy', 'r', 'delta', 'Fx')
    moving = namedtuple('Moving', names)(*(ca.SX.sym(name) for name in names))
    numbers, parameters = car_symbols(structure(car))
    lambda_b, d_delta, d_Fx = (ca.SX.sym(name) for name in ('lambda_b', 'd_delta', 'd_Fx'))
    body = body_rates(moving, Input(d_delta, d_Fx, lambda_b, slack=0.0), parameters)
    ay = body.vy + moving.r * moving.vx
    rates = ca.vertcat(body.vx, body.vy, body.r, d_delta, d_Fx)
    jerk = ca.jtimes(ay, ca.vertcat(*moving), rates)
    arguments = [ca.vertcat(*moving), ca.vertcat(lambda_b, d_delta, d_Fx), numbers]
    f = ca.Function('lateral_jerk', arguments, [jerk])
    state = ca.vertcat(x.vx, x.vy, x.r, x.delta, x.Fx)
    return f(state, ca.vertcat(u.lambda_b, u.d_delta, u.d_Fx), ca.vertcat(*car))


def derivative(x: State, u: Input, car: Car) -> State:
    """Return dx/dt as a `State` (paper, eq. 1)."""
    body = body_rates(x, u, car)
    sin_psi, cos_psi = ca.sin(x.psi), ca.cos(x.psi)
    return State(
        X=x.vx * cos_psi - x.vy * sin_psi,
        Y=x.vx * sin_psi + x.vy * cos_psi,
        psi=x.r,
        vx=body.vx,
        vy=body.vy,
        r=body.r,
        theta=travel_rate(x, car),
        delta=u.d_delta,
        Fx=u.d_Fx,
    )


def travel_rate(x, car: Car):
    """Return the speed [m/s]; near standstill that of a kinematic car is rounded.

    Their exact speed has a corner there, whose curvature a solver does not get past.
    """
    square = x.vx**2 + x.vy**2
    exact = ca.sqrt(square + STANDSTILL_ROUNDING)
    if _is_off(car.kinematic_below):
        return exact
    share = dynamic_share(x, car)
    return share * exact + (1 - share) * square / ca.sqrt(square + CREEP_MPS**2)


@cache
def step(dt: float, structure: Car = PAPER) -> ca.Function:
    """Return (x, u, car) -> the state `dt` [s] later, by one midpoint step (Runge-Kutta 2)."""
    f = rates(structure)
    x, u, car = f.sx_in()
    return ca.Function('step', [x, u, car], [rk2(f, dt)(x, u, car)], ['x', 'u', 'car'], ['x_next'])


@cache
def rates(structure: Car) -> ca.Function:
    """Return (x, u, car) -> dx/dt for the cars of a structure."""
    x, u = ca.SX.sym('x', len(State._fields)), ca.SX.sym('u', len(Input._fields))
    numbers, car = car_symbols(structure)
    derivatives = derivative(State(*ca.vertsplit(x)), Input(*ca.vertsplit(u)), car)
    return ca.Function('rates', [x, u, numbers], [ca.vertcat(*derivatives)])
