"""The multi-body model of CommonRoad (BMW 320i) with our actuators, inputs and outputs.

The equations are `vehicle_dynamics_mb` of the package commonroad-vehicle-models (Althoff and
Wuersching, CommonRoad: Vehicle Models, 2020), evaluated on symbols as they are installed. This file
adds what lies between that function and the rest of the plant:

inputs    Its steering velocity is the rate of our steering servo. Its acceleration is the sum of
          our axle forces over the mass; it turns that into wheel torques with its own split (66 %
          of the brakes at the front, rear-wheel drive), whatever split was commanded. Brakes hold
          a car that stands; the model alone would drive backwards.
friction  The road scales the peak of each tyre's forces, and the vertical shift of the lateral
          one, as LMUX and LMUY of our car do. The slip stiffness stays.
axes      Its axes are those of SAE J670: y to the right, z down, steer, heading and yaw rate
          positive to the right, pitch positive when the nose rises. `Body` keeps them, so that its
          left wheels are the left ones; inputs and outputs change sign. Roll has the same sign.
          Its longitudinal slip is the negative of ours.
outputs   Accelerations are those of the sprung mass.
domain    Its slips are divided by the speeds of the wheels along their planes, and its tyres are
          springs that pull, too. A car of which a wheel does not roll forwards any more, or which
          rolls over, slides on as a rigid body on four locked wheels (Coulomb friction, static
          loads) until it rests, and never comes back.
"""

import math
from dataclasses import replace
from functools import cache
from itertools import cycle
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

from node_runtime import named_vector
from vehicle_plant import actuators
from vehicle_plant.car import PlantParams
from vehicle_plant.initial_state import Start
from vehicle_plant.integrator import Model
from vehicle_plant.multi_body import symbolic
from vehicle_plant.state import (
    Acceleration,
    FourLoads,
    FourWheels,
    Outputs,
    PerWheel,
    Planar,
    Ride,
    Servo,
    Servos,
    SetPoints,
    State,
    WheelLoad,
    WheelState,
)
from vehicle_plant.wheel import contact_motion

_PACKAGE = 'vehiclemodels'
_SUFFIXES = ('lf', 'rf', 'lr', 'rr')  # of its variables, in the order of WHEELS
_KINEMATIC_MPS = 0.1  # below, the model is kinematic and divides by no wheel speed
_SLOW_MPS = 0.5  # faster across, a car that is slow ahead slides
_GREATEST_ROLL_RAD = 0.5  # of the body and of each axle; it rolls over
_LEAST_ROLLING_MPS = 0.02  # of every wheel along its plane, at rest
_LEAST_ROLLING_S = 0.005  # times the speed in addition: it falls in steps of 1 ms
_SMOOTH_MPS = 0.05  # of the Coulomb friction
_SPIN_DECAY_PS = 20.0  # of a wheel of a sliding car


class UnsprungAxle(NamedTuple):
    """An axle relative to the road, in the axes of the model."""

    phi: Any  # rad
    p: Any  # rad/s
    vy: Any  # m/s, right
    z: Any  # m, down
    vz: Any  # m/s


class Body(NamedTuple):
    """The 29 states of the model, in its order, signs and axes (y right, z down)."""

    X: Any  # m, of the sprung mass
    Y: Any  # m
    delta: Any  # rad, right
    vx: Any  # m/s
    psi: Any  # rad, right
    r: Any  # rad/s
    phi: Any  # rad
    p: Any  # rad/s
    theta: Any  # rad
    q: Any  # rad/s
    vy: Any  # m/s, right
    z: Any  # m, down
    vz: Any  # m/s
    front: UnsprungAxle
    rear: UnsprungAxle
    omega: PerWheel  # rad/s
    front_shift: Any  # m, lateral, in the joint of the axle
    rear_shift: Any  # m


class MultiBodyState(NamedTuple):
    """State of the plant: the model, our servos, and whether the car slides outside the model."""

    body: Body
    servos: Servos
    slides: Any  # 0 or 1

    @property
    def planar(self) -> Planar:
        """The planar motion in our axes."""
        b = self.body
        return Planar(b.X, -b.Y, -b.psi, b.vx, -b.vy, -b.r)


@cache
def vehicle():
    """Return the parameters of the model: vehicle 2, a BMW 320i."""
    return parameters_vehicle2()


class _TyrePerWheel:
    """The parameters of the model with a tyre for each wheel.

    The model takes its tyre four times for each of its formulas, in the order of WHEELS.
    """

    def __init__(self, parameters, tyres):
        self._parameters, self._tyres = parameters, cycle(tyres)

    def __getattr__(self, name):
        return next(self._tyres) if name == 'tire' else getattr(self._parameters, name)


def evaluate_model(b: Body, steer_rate, acceleration, grips):
    """Return the derivative of the 29 states, and the variables of the model, on symbols.

    grips: factors of the longitudinal and of the lateral friction of each tyre.
    """
    tyre, tyres = vehicle().tire, []
    for grip_x, grip_y in grips:
        factors = {'p_dx1': grip_x, 'p_dy1': grip_y, 'p_vy1': grip_y, 'p_vy3': grip_y}
        scaled = {name: factor * getattr(tyre, name) for name, factor in factors.items()}
        tyres.append(replace(tyre, **scaled))
    arguments = (
        named_vector.leaves(b),
        [steer_rate, acceleration],
        _TyrePerWheel(vehicle(), tyres),
    )
    f, variables = symbolic.evaluate(vehicle_dynamics_mb, arguments, (_PACKAGE,))
    return named_vector.build(Body, f), variables


def derivative(
    x: MultiBodyState, u: SetPoints, plant: PlantParams, friction: PerWheel
) -> tuple[MultiBodyState, tuple[State, Outputs]]:
    """Return the derivative of the state, and the row of a trajectory; see `integrator.Model`."""
    p, b, servos = vehicle(), x.body, x.servos
    force = servos.front.position + servos.rear.position
    holds = ca.logic_and(b.vx <= 0, force < 0)
    acceleration = ca.if_else(holds, 0, force / p.m)
    front, rear = plant.car.scaling.front, plant.car.scaling.rear
    factors = zip(friction, (front, front, rear, rear))
    grips = [(mu * axle.LMUX, mu * axle.LMUY) for mu, axle in factors]
    rolling_dot, variables = evaluate_model(b, -servos.steer.rate, acceleration, grips)
    sliding_dot, sliding_forces = _slide(b, -servos.steer.rate, grips)
    pairs = zip(named_vector.leaves(sliding_dot), named_vector.leaves(rolling_dot), strict=True)
    body_dot = named_vector.build(Body, [ca.if_else(x.slides, a, c) for a, c in pairs])
    laws = zip(x.servos, u, actuators.servo_parameters(plant.car), strict=True)
    servos_dot = Servos(*(actuators.servo_derivative(*law) for law in laws))
    # a car that stands is held by what its brakes are set to
    applied = ca.if_else(holds, force, p.m * variables['u'][1])
    row = _row(x, body_dot, variables, applied, sliding_forces)
    return MultiBodyState(body_dot, servos_dot, 0), row


def project(x: MultiBodyState, car) -> MultiBodyState:
    """Return the state within its constraints; a car that left the domain of the model slides."""
    b = x.body
    servos = Servos(*map(actuators.stop_at_limits, x.servos, actuators.servo_parameters(car)))
    slides = ca.if_else(_within_domain(b), x.slides, 1)
    stands = ca.logic_and(b.vx <= 0, ca.logic_not(slides))

    def unless_standing(value):
        return ca.if_else(stands, 0, value)

    body = b._replace(
        delta=-servos.steer.position,
        vx=unless_standing(b.vx),
        vy=unless_standing(b.vy),
        r=unless_standing(b.r),
        front=b.front._replace(vy=unless_standing(b.front.vy)),
        rear=b.rear._replace(vy=unless_standing(b.rear.vy)),
        omega=PerWheel(*(ca.fmax(omega, 0) for omega in b.omega)),
    )
    return MultiBodyState(body, servos, slides)


def _contacts(b):
    """Yield position (x, y) [m], velocity (Vx, Vy) and angle of each wheel; y to the right."""
    p = vehicle()
    for x, y, angle in ((p.a, p.T_f / 2, b.delta), (-p.b, p.T_r / 2, 0)):
        for side in (-1, 1):
            yield x, side * y, b.vx - side * y * b.r, b.vy + x * b.r, angle


def _within_domain(b):
    speed = ca.sqrt(b.vx**2 + b.vy**2)
    least = _LEAST_ROLLING_MPS + _LEAST_ROLLING_S * speed
    rolling = b.vx >= _KINEMATIC_MPS
    for _, _, Vx, Vy, angle in _contacts(b):
        rolling = ca.logic_and(rolling, contact_motion(Vx, Vy, angle, 0, 0).Vx > least)
    across = ca.fabs(b.vy) + ca.fabs(b.r)  # of a point a metre away
    slow = ca.logic_and(ca.fabs(b.vx) < _KINEMATIC_MPS, across < _SLOW_MPS)
    upright = 1
    for roll in (b.phi, b.front.phi, b.rear.phi):
        upright = ca.logic_and(upright, ca.fabs(roll) < _GREATEST_ROLL_RAD)
    return ca.logic_and(upright, ca.logic_or(rolling, slow))


def static_loads() -> PerWheel:
    """Return the vertical tyre loads at standstill [N], those of the start of the model."""
    start = named_vector.build(Body, init_mb([0.0] * 7, vehicle()))
    stiffness = vehicle().K_zt
    return PerWheel(*(z * stiffness for z in (start.front.z,) * 2 + (start.rear.z,) * 2))


def _slide(b, steer_rate, grips):
    """Return the derivative of a car that slides on locked wheels, and its forces per wheel."""
    p, peak = vehicle(), vehicle().tire.p_dy1
    forces, (Fx, Fy, Mz) = [], (0, 0, 0)
    for (x, y, Vx, Vy, _), (_, grip), load in zip(_contacts(b), grips, static_loads()):
        per_speed = grip * peak * load / ca.sqrt(Vx**2 + Vy**2 + _SMOOTH_MPS**2)
        fx, fy = -per_speed * Vx, -per_speed * Vy
        Fx, Fy, Mz = Fx + fx, Fy + fy, Mz + x * fy - y * fx
        forces.append((fx, fy))
    c, s = ca.cos(b.psi), ca.sin(b.psi)
    still = named_vector.build(Body, [0] * len(named_vector.names(Body)))
    dot = still._replace(
        X=b.vx * c - b.vy * s,
        Y=b.vx * s + b.vy * c,
        psi=b.r,
        delta=steer_rate,
        vx=Fx / p.m + b.r * b.vy,
        vy=Fy / p.m - b.r * b.vx,
        r=Mz / p.I_z,
        omega=PerWheel(*(-_SPIN_DECAY_PS * omega for omega in b.omega)),
    )
    return dot, forces


def _row(x, dot, variables, force, sliding_forces):
    """Return the state and the outputs in our signs and axes.

    dot: derivative of the body; force: of both axles [N], within the limits of the model.
    """
    p, b, planar = vehicle(), x.body, x.planar
    loads, wheels, contacts = [], [], list(_contacts(b))
    brake, drive = ca.fmin(force, 0), ca.fmax(force, 0)
    shares = ((p.T_sb, p.T_se), (1 - p.T_sb, 1 - p.T_se))
    axles = ((b.front, p.T_f), (b.rear, p.T_r))
    at_rest = static_loads()
    for i, suffix in enumerate(_SUFFIXES):
        (axle, track), side = axles[i // 2], (1, -1)[i % 2]
        angle = contacts[i][-1]
        c, s = ca.cos(angle), ca.sin(angle)
        fx, fy = sliding_forces[i]
        name = suffix.upper()
        Fz = ca.if_else(x.slides, at_rest[i], variables[f'F_z_{name}'])
        Fx = ca.if_else(x.slides, c * fx + s * fy, variables[f'F_x_{name}'])
        Fy = -ca.if_else(x.slides, -s * fx + c * fy, variables[f'F_y_{name}'])
        brake_share, drive_share = shares[i // 2]
        torque = (brake_share * brake + drive_share * drive) * p.R_w / 2
        loads.append(WheelLoad(ca.if_else(x.slides, 0, torque), Fz, Fx, Fy))
        per_roll = p.R_w * ca.sin(axle.phi) + side * track / 2 * ca.cos(axle.phi)
        sinking = axle.vz - per_roll * axle.p
        wheels.append(
            WheelState(
                z=(at_rest[i] - Fz) / p.K_zt,
                vz=ca.if_else(x.slides, 0, -sinking),
                omega=b.omega[i],
                windup=1,  # the model has no brake lining
                kappa=ca.if_else(x.slides, -1, -variables[f's_{suffix}']),
                tan_alpha=ca.if_else(x.slides, 0, -ca.tan(variables[f'alpha_{name}'])),
            )
        )
    total_rate = x.servos.front.rate + x.servos.rear.rate
    servos = [
        Servo(
            brake_share * brake + drive_share * drive,
            total_rate * ca.if_else(brake < 0, brake_share, drive_share),
        )
        for brake_share, drive_share in shares
    ]
    ride = Ride(-b.z, -b.vz, b.phi, b.p, -b.theta, -b.q)
    state = State(planar, ride, FourWheels(*wheels), Servos(x.servos.steer, *servos))
    acceleration = Acceleration(dot.vx - b.r * b.vy, -(dot.vy + b.r * b.vx))
    return state, Outputs(acceleration, FourLoads(*loads))


def start(params: PlantParams, start: Start) -> np.ndarray:
    """Return the flat state of a car that rolls as `start` says, springs at rest."""
    speed, beta = math.hypot(start.speed, start.vy), math.atan2(start.vy, start.speed)
    initial = [start.X, -start.Y, 0.0, speed, -start.psi, -start.r, -beta]
    b = named_vector.build(Body, init_mb(initial, vehicle()))
    spins = [max(Vx, 0.0) / vehicle().R_w for _, _, Vx, _, _ in _contacts(b)]
    at_rest = Servos(*(Servo(0.0, 0.0),) * len(Servos._fields))
    x = MultiBodyState(b._replace(omega=PerWheel(*spins)), at_rest, 0.0)
    return np.array(named_vector.leaves(x), float)


_NAMES = named_vector.names(MultiBodyState)
_VX, _VY, _R = (_NAMES.index(f'body.{name}') for name in ('vx', 'vy', 'r'))
_RK4_LIMIT = 2.0  # of the fastest mode times the step, below the limit of stability of 2.8
_MODE_MPS = 8000.0  # m/s^2: the spin of a loaded wheel decays at this over its speed
_BURST_MPS = 0.6  # that a burst of 50 ms may slow down by


def steps_per_ms(x: np.ndarray) -> int:
    """Return the steps per millisecond that the spin of the slowest wheel needs.

    The slips of the model have no relaxation, so the spin decays at R^2 Kx / (I V), with V the
    speed of the wheel: the slower, the faster.
    """
    slowest = x[_VX] - vehicle().T_f / 2 * abs(x[_R]) - _BURST_MPS
    rate = _MODE_MPS / max(slowest, _KINEMATIC_MPS)
    return math.ceil(rate * 1e-3 / _RK4_LIMIT)


MULTI_BODY = Model(
    'multi_body_plant',
    MultiBodyState,
    derivative,
    project,
    start,
    steps_per_ms,
    state_in_row=False,
)
