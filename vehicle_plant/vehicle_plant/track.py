"""What a simulated stretch of time leaves behind: one row per millisecond."""

from typing import NamedTuple

import numpy as np

from msgs_yaml.types import WHEELS, Actuators, Imu, VehicleState, Wheels
from vehicle_plant import named
from vehicle_plant.state import Readings, State

_COLUMNS = {name: i for i, name in enumerate((*named.names(State), *named.names(Readings)))}


_PLANAR = [_COLUMNS[f'planar.{name}'] for name in ('X', 'Y', 'psi', 'vx', 'vy', 'r')]
_SERVOS = [
    _COLUMNS[f'servos.{name}']
    for name in ('steer.position', 'steer.rate', 'front.position', 'rear.position')
]
_TORQUES = [_COLUMNS[f'loads.{wheel}.torque'] for wheel in WHEELS]
_IMU = [_COLUMNS[name] for name in ('acceleration.ax', 'acceleration.ay', 'planar.r')]
# where a `Wheels` finds its fields, in their order; its slip angle is kept as a tangent
_OF_WHEELS = {
    'omega': 'wheels',
    'torque': 'loads',
    'Fz': 'loads',
    'kappa': 'wheels',
    'Fx': 'loads',
    'tan_alpha': 'wheels',
    'Fy': 'loads',
}
_WHEELS = [_COLUMNS[f'{group}.{w}.{name}'] for name, group in _OF_WHEELS.items() for w in WHEELS]
_FIRSTS = range(0, len(_WHEELS), len(WHEELS))
_SLIP_ANGLES = slice(_FIRSTS[list(_OF_WHEELS).index('tan_alpha')], _FIRSTS[-1])


class Track(NamedTuple):
    """n milliseconds of motion; column names are the dotted names of `state`."""

    stamp_ns: np.ndarray  # (n,) int64
    rows: np.ndarray  # (n, state + readings)

    def column(self, name: str) -> np.ndarray:
        """Return a column, (n,): `planar.vx`, `ride.phi`, `wheels.fl.omega`, `loads.rr.Fz` ..."""
        return self.rows[:, _COLUMNS[name]]

    def where(self, chosen: np.ndarray) -> 'Track':
        """Return the rows that a mask (n,) chooses."""
        return Track(self.stamp_ns[chosen], self.rows[chosen])

    def states(self) -> list[VehicleState]:
        """Return the planar motion at each row; the heading is wrapped to (-pi, pi]."""
        return [
            VehicleState(stamp_ns, X, Y, wrapped(psi), *velocities)
            for stamp_ns, (X, Y, psi, *velocities) in self._stamped(_PLANAR)
        ]

    def actuators(self) -> list[Actuators]:
        """Return where the servos are at each row."""
        torques = self.rows[:, _TORQUES].tolist()
        return [
            Actuators(stamp_ns, *servos, tuple(torque))
            for (stamp_ns, servos), torque in zip(self._stamped(_SERVOS), torques)
        ]

    def imu(self) -> list[Imu]:
        """Return the accelerations of the CoG at each row."""
        return [Imu(stamp_ns, *values) for stamp_ns, values in self._stamped(_IMU)]

    def wheels(self) -> list[Wheels]:
        """Return the wheels at each row; slips are the transient ones."""
        values = self.rows[:, _WHEELS]
        values[:, _SLIP_ANGLES] = np.arctan(values[:, _SLIP_ANGLES])
        return [
            Wheels(stamp_ns, *(tuple(row[first : first + len(WHEELS)]) for first in _FIRSTS))
            for stamp_ns, row in zip(self.stamp_ns.tolist(), values.tolist())
        ]

    def _stamped(self, places):
        return zip(self.stamp_ns.tolist(), self.rows[:, places].tolist())


def wrapped(psi: float) -> float:
    """Return a heading in (-pi, pi]."""
    return float(np.pi - (np.pi - psi) % (2 * np.pi))


def join(tracks: list[Track]) -> Track:
    """Return consecutive tracks as one."""
    return Track(*(np.concatenate(parts) for parts in zip(*tracks)))
