"""What the integrator's step leaves of the truth: a manoeuvre against itself in shorter steps."""

from typing import NamedTuple

import numpy as np

from msgs_yaml.types import WHEELS
from vehicle_plant import graph
from vehicle_plant.manoeuvres import course
from vehicle_plant.manoeuvres.course import Case, Run
from vehicle_plant.track import Track

REFERENCE_S = graph.STEP_S / 10


class Error(NamedTuple):
    """Greatest differences over a run, or over several."""

    position: float  # m
    yaw_rate: float  # rad/s
    acceleration: float  # m/s^2, of the CoG, either way
    slip: float  # -, transient slip of any wheel, either way

    def or_greater(self, other: 'Error') -> 'Error':
        """Return the greater of each."""
        return Error(*map(max, self, other))


def errors(run: Run, case: Case, steps_s: tuple[float, ...]) -> list[Error]:
    """Return the error with each step against a tenth of a millisecond."""
    reference = course.drive(run, case, step_s=REFERENCE_S)
    return [_between(course.drive(run, case, step_s=h), reference) for h in steps_s]


def _between(track: Track, reference: Track) -> Error:
    """Compare at the instants that both have; the reference has every millisecond."""
    rows = (track.stamp_ns - reference.stamp_ns[0]) // np.diff(reference.stamp_ns[:2])

    def greatest(*names):
        return max(float(np.abs(track.column(n) - reference.column(n)[rows]).max()) for n in names)

    return Error(
        greatest('planar.X', 'planar.Y'),
        greatest('planar.r'),
        greatest('acceleration.ax', 'acceleration.ay'),
        greatest(*(f'wheels.{w}.{slip}' for w in WHEELS for slip in ('kappa', 'tan_alpha'))),
    )


def order(coarse: float, fine: float) -> float:
    """Return the order that two errors show whose steps differ by a factor of two."""
    return float(np.log2(coarse / fine))
