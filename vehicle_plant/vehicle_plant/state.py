"""State, set-points and outputs as named vectors (`named_vector`), and trajectories of them.

SI units, ISO 8855 axes. The dotted names of the fields are the column names of a trajectory.
"""

from typing import Any, NamedTuple

import numpy as np

from msgs_yaml.types import WHEELS, Actuators, Imu, VehicleState, Wheels
from node_runtime import named_vector


class Planar(NamedTuple):
    """Planar motion of the CoG: pose in the map, velocities in the vehicle frame."""

    X: Any  # m
    Y: Any  # m
    psi: Any  # rad
    vx: Any  # m/s
    vy: Any  # m/s
    r: Any  # rad/s


class Ride(NamedTuple):
    """Vertical motion of the sprung body relative to its static position."""

    z: Any  # m, up
    vz: Any  # m/s
    phi: Any  # rad, roll, positive: left side up
    p: Any  # rad/s
    theta: Any  # rad, pitch, positive: nose down
    q: Any  # rad/s


class WheelState(NamedTuple):
    """One wheel and its tyre."""

    z: Any  # m, up, relative to its static position
    vz: Any  # m/s
    omega: Any  # rad/s, spin, positive forwards
    windup: Any  # -, brake lining: slips at -1 and 1, sticks between them
    kappa: Any  # -, transient longitudinal slip
    tan_alpha: Any  # -, transient side slip, Vy / |Vx|


def _per_wheel(name, kind):
    """Return a named tuple with a value per wheel, in the order of `msgs_yaml.types.WHEELS`."""
    return NamedTuple(name, [(wheel, kind) for wheel in WHEELS])


PerWheel = _per_wheel('PerWheel', Any)
FourWheels = _per_wheel('FourWheels', WheelState)


class Servo(NamedTuple):
    """An actuator: its position [rad or N] and its rate."""

    position: Any
    rate: Any


class Servos(NamedTuple):
    """Road-wheel steering angle [rad], axle forces at the contact patches [N]."""

    steer: Servo
    front: Servo
    rear: Servo


class State(NamedTuple):
    """The state vector x."""

    planar: Planar
    ride: Ride
    wheels: FourWheels
    servos: Servos


class SetPoints(NamedTuple):
    """The input vector u, which the servos follow."""

    delta: Any  # rad
    Fxf: Any  # N
    Fxr: Any  # N


class Acceleration(NamedTuple):
    """Acceleration of the CoG without gravity, vehicle frame."""

    ax: Any  # m/s^2
    ay: Any  # m/s^2


class WheelLoad(NamedTuple):
    """Torque and contact force of a wheel, tyre axes."""

    torque: Any  # N m, drive plus brake
    Fz: Any  # N
    Fx: Any  # N
    Fy: Any  # N


FourLoads = _per_wheel('FourLoads', WheelLoad)


class Outputs(NamedTuple):
    """The output vector y: measured but not integrated."""

    acceleration: Acceleration
    loads: FourLoads


_COLUMNS = {
    name: i for i, name in enumerate((*named_vector.names(State), *named_vector.names(Outputs)))
}
_PLANAR = [_COLUMNS[f'planar.{name}'] for name in Planar._fields]
_SERVOS = [
    _COLUMNS[f'servos.{name}']
    for name in ('steer.position', 'steer.rate', 'front.position', 'rear.position')
]
_IMU = [_COLUMNS[name] for name in ('acceleration.ax', 'acceleration.ay', 'planar.r', 'ride.p')]
# by field of the message `Wheels`
_WHEELS = {
    field: [_COLUMNS[column.format(w)] for w in WHEELS]
    for field, column in {
        'omega': 'wheels.{}.omega',
        'torque': 'loads.{}.torque',
        'Fz': 'loads.{}.Fz',
        'kappa': 'wheels.{}.kappa',
        'Fx': 'loads.{}.Fx',
        'alpha': 'wheels.{}.tan_alpha',
        'Fy': 'loads.{}.Fy',
    }.items()
}


class Trajectory(NamedTuple):
    """State and outputs over time, one row per millisecond by default."""

    stamp_ns: np.ndarray  # (n,) int64
    rows: np.ndarray  # (n, state + outputs)

    def __repr__(self) -> str:
        return f'Trajectory({len(self.rows)} rows from {self.stamp_ns[:1].tolist()} ns)'

    def column(self, name: str) -> np.ndarray:
        """Return a column, (n,): `planar.vx`, `ride.phi`, `wheels.fl.omega`, `loads.rr.Fz` ..."""
        return self.rows[:, _COLUMNS[name]]

    def where(self, selected: np.ndarray | slice | list[int]) -> 'Trajectory':
        """Return the rows that a mask (n,), a slice or a list of their numbers selects."""
        return Trajectory(self.stamp_ns[selected], self.rows[selected])

    def state_columns(self) -> VehicleState:
        """Return the planar motion, each field (n,); the heading is wrapped to (-pi, pi]."""
        X, Y, psi, *velocities = self.rows[:, _PLANAR].T
        return VehicleState(self.stamp_ns, X, Y, wrap_angle(psi), *velocities)

    def actuator_columns(self) -> Actuators:
        """Return the servos' positions, each (n,), and the wheel torques (n, 4)."""
        servos = self.rows[:, _SERVOS].T
        return Actuators(self.stamp_ns, *servos, self.rows[:, _WHEELS['torque']])

    def imu_columns(self) -> Imu:
        """Return accelerations of the CoG, yaw and roll rate, each (n,)."""
        return Imu(self.stamp_ns, *self.rows[:, _IMU].T)

    def wheel_columns(self) -> Wheels:
        """Return the values of the wheels, each (n, 4); slips are the transient ones."""
        fields = {field: self.rows[:, columns] for field, columns in _WHEELS.items()}
        fields['alpha'] = np.arctan(fields['alpha'])
        return Wheels(self.stamp_ns, **fields)

    def state(self, i: int) -> VehicleState:
        """Return the message value of `state_columns` of a row."""
        return messages(self.where(slice(i, i + 1)).state_columns())[0]


def messages(columns: NamedTuple) -> list:
    """Return columns of a trajectory, (n,) or (n, 4), as n message values of their type."""
    values = [map(tuple, c.tolist()) if c.ndim > 1 else c.tolist() for c in columns]
    return [type(columns)(*row) for row in zip(*values)]


def wrap_angle(psi):
    """Return headings in (-pi, pi]; numbers or arrays."""
    return np.pi - (np.pi - psi) % (2 * np.pi)


def join_trajectories(trajectories: list[Trajectory]) -> Trajectory:
    """Return consecutive trajectories as one."""
    return Trajectory(*(np.concatenate(parts) for parts in zip(*trajectories)))
