"""What a simulated stretch of time leaves behind: one row per millisecond."""

from typing import NamedTuple

import numpy as np

from msgs_yaml.types import WHEELS, Actuators, Imu, VehicleState, Wheels
from vehicle_plant import named
from vehicle_plant.state import Readings, State

_COLUMNS = {name: i for i, name in enumerate((*named.names(State), *named.names(Readings)))}


def _of_wheels(group: str, field: str) -> list[int]:
    return [_COLUMNS[f'{group}.{w}.{field}'] for w in WHEELS]


class _Places(NamedTuple):
    """Columns of each message."""

    planar: list[int]
    servos: list[int]
    torque: list[int]
    acceleration: list[int]
    omega: list[int]
    Fz: list[int]
    kappa: list[int]
    Fx: list[int]
    tan_alpha: list[int]
    Fy: list[int]


_PLACES = _Places(
    planar=[_COLUMNS[f'planar.{name}'] for name in ('X', 'Y', 'psi', 'vx', 'vy', 'r')],
    servos=[
        _COLUMNS[f'servos.{name}']
        for name in ('steer.position', 'steer.rate', 'front.position', 'rear.position')
    ],
    torque=_of_wheels('loads', 'torque'),
    acceleration=[_COLUMNS['acceleration.ax'], _COLUMNS['acceleration.ay']],
    omega=_of_wheels('wheels', 'omega'),
    Fz=_of_wheels('loads', 'Fz'),
    kappa=_of_wheels('wheels', 'kappa'),
    Fx=_of_wheels('loads', 'Fx'),
    tan_alpha=_of_wheels('wheels', 'tan_alpha'),
    Fy=_of_wheels('loads', 'Fy'),
)


class Track(NamedTuple):
    """n milliseconds of motion; column names are the dotted names of `state`."""

    stamp_ns: np.ndarray  # (n,) int64
    rows: np.ndarray  # (n, state + readings)

    def column(self, name: str) -> np.ndarray:
        """Return a column, (n,): `planar.vx`, `ride.phi`, `wheels.fl.omega`, `loads.rr.Fz` ..."""
        return self.rows[:, _COLUMNS[name]]

    def state(self, row: int) -> VehicleState:
        """Return the planar motion at a row; the heading is wrapped to (-pi, pi]."""
        X, Y, psi, *velocities = self.rows[row, _PLACES.planar].tolist()
        return VehicleState(int(self.stamp_ns[row]), X, Y, wrapped(psi), *velocities)

    def actuators(self, row: int) -> Actuators:
        """Return where the servos are at a row."""
        delta, d_delta, Fxf, Fxr = self.rows[row, _PLACES.servos].tolist()
        torque = tuple(self.rows[row, _PLACES.torque].tolist())
        return Actuators(int(self.stamp_ns[row]), delta, d_delta, Fxf, Fxr, torque)

    def imu(self, row: int) -> Imu:
        """Return the accelerations of the CoG at a row."""
        ax, ay = self.rows[row, _PLACES.acceleration].tolist()
        return Imu(int(self.stamp_ns[row]), ax, ay, float(self.rows[row, _COLUMNS['planar.r']]))

    def wheels(self, row: int) -> Wheels:
        """Return the wheels at a row; slips are the transient ones."""
        values = self.rows[row]
        return Wheels(
            stamp_ns=int(self.stamp_ns[row]),
            omega=tuple(values[_PLACES.omega].tolist()),
            torque=tuple(values[_PLACES.torque].tolist()),
            Fz=tuple(values[_PLACES.Fz].tolist()),
            kappa=tuple(values[_PLACES.kappa].tolist()),
            Fx=tuple(values[_PLACES.Fx].tolist()),
            alpha=tuple(np.arctan(values[_PLACES.tan_alpha]).tolist()),
            Fy=tuple(values[_PLACES.Fy].tolist()),
        )


def wrapped(psi: float) -> float:
    """Return a heading in (-pi, pi]."""
    return float(np.pi - (np.pi - psi) % (2 * np.pi))


def join(tracks: list[Track]) -> Track:
    """Return consecutive tracks as one."""
    return Track(*(np.concatenate(parts) for parts in zip(*tracks)))
