"""Closed forms of small steering at constant speed, for comparison with the plant.

Linear single track (Mitschke; Pacejka 2012, 1.3), delta -> r at V, with slip angles

    alpha_f = (vy + l_f r) / V - delta,  alpha_r = (vy - l_r r) / V,  Fy = -C(s) alpha,

each axle a lag of first order with its relaxation length sigma and steered by its own force with
the compliance k (front: against the steer, rear: negative), C(s) = C / (1 + s sigma / V + k C):

    r             s m l_f C_f(s) + L C_f(s) C_r(s) / V
    ----- = ---------------------------------------------------------------------------------------
    delta   s^2 m I + s [m (l_f^2 C_f + l_r^2 C_r) + I (C_f + C_r)] / V
                                            + C_f C_r L^2 / V^2 + m (l_r C_r - l_f C_f)

(argument s of C omitted in the denominator). With sigma = 0 it is the classical form. The body adds
two effects: roll, which cambers and steers the wheels and moves the contact patches sideways, and
load transfer, which unbalances left and right in the thrust of static camber and in rolling
resistance. `yaw_rate_response` solves this extended linear model. SI, ISO 8855 axes. Not included:
drive and brake forces, aerodynamic lift.
"""

from typing import NamedTuple

import casadi as ca
import numpy as np

from vehicle_plant import suspension, tyre
from vehicle_plant.car import PlantParams
from vehicle_plant.suspension import Corner


class AxleSlopes(NamedTuple):
    """Slopes of one axle at static load, straight ahead."""

    corner: Corner  # the left one
    C: float  # N/rad, cornering stiffness, positive
    per_camber: float  # N/rad, lateral force per camber of both wheels
    per_load: float  # -, lateral force per load moved from the right to the left wheel
    sigma: float  # m, relaxation length
    side: int  # 1 front, -1 rear: sign of roll and compliance steer for understeer

    @property
    def C_effective(self) -> float:
        """Cornering stiffness with compliance steer [N/rad]."""
        return self.C / (1 + self.side * self.corner.axle.compliance_steer_radpn * self.C)


class LinearCar(NamedTuple):
    """Mass, inertia with the wheels that turn at different speeds, axles."""

    plant: PlantParams
    mass: float  # kg
    inertia: float  # kg m^2
    front: AxleSlopes
    rear: AxleSlopes

    @property
    def wheelbase(self) -> float:
        """[m]."""
        return self.front.corner.x - self.rear.corner.x

    @property
    def understeer(self) -> float:
        """Steer per lateral acceleration beyond that of the circle's radius [rad/(m/s^2)]."""
        f, r = self.front, self.rear
        return (
            self.mass / self.wheelbase * (-r.corner.x / f.C_effective - f.corner.x / r.C_effective)
        )

    def steer(self, ay: float, V: float) -> float:
        """Return the steer for a lateral acceleration at a speed [rad]."""
        return ay * (self.wheelbase / V**2 + self.understeer)


def linear_car(plant: PlantParams, friction: float) -> LinearCar:
    """Return the linear model of a car, with the slopes of its own tyres."""
    car = plant.car
    left_front, _, left_rear, _ = suspension.wheel_corners(car)
    spin = 2 * car.wheel.spin_inertia_kgm2 / car.wheel.radius_m**2
    return LinearCar(
        plant,
        car.body.mass_kg,
        car.body.yaw_inertia_kgm2 + spin * float(left_front.y**2 + left_rear.y**2),
        _axle_slopes(plant, friction, left_front, car.scaling.front),
        _axle_slopes(plant, friction, left_rear, car.scaling.rear),
    )


def _axle_slopes(plant: PlantParams, friction: float, corner: Corner, scaling) -> AxleSlopes:
    """Return the slopes of an axle from the left tyre; the right one is its mirror image."""
    wheel = plant.car.wheel
    Fz, tan_alpha, gamma = (ca.SX.sym(name) for name in ('Fz', 'tan_alpha', 'gamma'))
    contact = tyre.Contact(Fz, 0, tan_alpha, gamma, friction, wheel.pressure_pa)
    Fy = tyre.force(contact, plant.tyre, scaling).Fy
    slopes = ca.Function(
        'slopes', [Fz, tan_alpha, gamma], [ca.jacobian(Fy, v) for v in (Fz, tan_alpha, gamma)]
    )
    at_rest = (float(corner.Fz_static), 0.0, -corner.axle.static_camber_rad)
    per_load, per_slip, per_camber = (float(slope) for slope in slopes(*at_rest))
    static = contact._replace(Fz=at_rest[0], tan_alpha=0.0, gamma=at_rest[-1])
    sigma = -float(tyre.stiffness(static, plant.tyre, scaling).Ky) / wheel.lateral_stiffness_npm
    side = 1 if corner.x > 0 else -1
    return AxleSlopes(corner, -2 * per_slip, 2 * per_camber, 2 * per_load, sigma, side)


def yaw_rate_response(
    car: LinearCar, V: float, f_hz: np.ndarray, relaxation: bool = True, body: bool = False
) -> np.ndarray:
    """Return r / delta [1/s] at each frequency, complex, (n,).

    relaxation: with the lag of the tyres; body: with roll and load transfer, without which the CoG
    and the roll centres are on the road.

    The unknowns are vy, r, roll phi, and per axle the travel z of the left wheel and the force Fy;
    left and right wheels move oppositely. Per axle, with h_i the height of its roll centre and y
    half its track: the contact moves sideways at vy + x r + (h - h_i) s phi + h_i / y s z; springs,
    bars and dampers carry the body with S (z - y phi), the tyre the wheel with T z; the links pass
    h_i / (2 y) Fy on to each wheel.
    """
    s = 2j * np.pi * np.asarray(f_hz, dtype=float)
    p = car.plant.car
    h, tyres = body * p.body.cog_height_m, p.wheel
    unsprung = 2 * (p.suspension.front.unsprung_mass_kg + p.suspension.rear.unsprung_mass_kg)
    weight = (car.mass - unsprung) * p.body.gravity_mps2
    axles = (car.front, car.rear)
    L = car.wheelbase
    roll_axis = sum(
        body * a.corner.axle.roll_centre_height_m * abs(other.corner.x) / L
        for a, other in zip(axles, axles[::-1])
    )
    vy, r, phi = 0, 1, 2
    n = 3 + 2 * len(axles)
    A = np.zeros((len(s), n, n), dtype=complex)
    b = np.zeros((len(s), n), dtype=complex)
    A[:, 0, vy], A[:, 0, r] = car.mass * s, car.mass * V
    A[:, 1, r] = car.inertia * s
    A[:, 2, phi] = p.body.roll_inertia_kgm2 * s**2 - weight * (h - roll_axis)
    for i, a in enumerate(axles):
        c, z, Fy = a.corner, 3 + 2 * i, 4 + 2 * i
        h_i, y = body * c.axle.roll_centre_height_m, c.y
        S = c.axle.ride_rate_npm + 2 * c.axle.antiroll_npm + s * c.axle.damper_rate_nspm
        T = tyres.vertical_stiffness_npm + s * tyres.vertical_damping_nspm
        A[:, 0, Fy], A[:, 1, Fy], A[:, 2, Fy] = -1, -c.x, -(h - h_i)
        A[:, 1, z] = 2 * y * tyres.rolling_resistance * T
        A[:, 2, z], A[:, 2, phi] = -2 * y * S, A[:, 2, phi] + 2 * y**2 * S
        A[:, z, z], A[:, z, phi] = c.axle.unsprung_mass_kg * s**2 + T + S, -y * S
        A[:, z, Fy] = -h_i / (2 * y)
        # Fy = -C tan(alpha) + camber by roll + static camber under shifted load
        C = a.C / (V + relaxation * a.sigma * s)
        A[:, Fy, vy], A[:, Fy, r] = C, C * c.x
        A[:, Fy, Fy] = 1 + C * V * a.side * c.axle.compliance_steer_radpn
        A[:, Fy, phi] = C * s * (h - h_i) - a.per_camber * c.axle.camber_per_roll
        A[:, Fy, phi] += C * V * a.side * c.axle.roll_steer
        A[:, Fy, z] = C * s * h_i / y + a.per_load * T
        if a is car.front:
            b[:, Fy] = C * V
    return np.linalg.solve(A, b[:, :, None])[:, r, 0]
