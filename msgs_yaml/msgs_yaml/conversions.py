"""Time stamps, headings and diagnostic values: between plain numbers and message fields.

Stamps are whole nanoseconds. A heading psi [rad] is the rotation about z by the quaternion
(0, 0, sin(psi / 2), cos(psi / 2)).
"""

import math
from typing import Any

import numpy as np

from msgs_yaml.types import (
    Branch,
    EstimatedState,
    Prediction,
    Predictions,
    Reference,
    StopPlan,
    VehicleState,
)

NS_PER_S = 1_000_000_000
_BOOLEANS = {'True': True, 'False': False}


def stamp_to_ns(stamp: Any) -> int:
    """Return the nanoseconds of a builtin_interfaces/Time of any library."""
    return int(stamp.sec) * NS_PER_S + int(stamp.nanosec)


def split_stamp(stamp_ns: int) -> tuple[int, int]:
    """Return (sec, nanosec)."""
    return divmod(int(stamp_ns), NS_PER_S)


def add_seconds(stamp_ns: int, t: float) -> int:
    """Return the stamp t seconds later, rounded to 1 ns."""
    return int(stamp_ns) + round(float(t) * NS_PER_S)


def ns_to_s(duration_ns: int) -> float:
    """Return a duration in seconds."""
    return duration_ns / NS_PER_S


def wrap_angle(psi: float) -> float:
    """Return the same angle in (-pi, pi]."""
    wrapped = math.remainder(psi, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


def heading_to_quaternion(psi: float) -> tuple[float, float]:
    """Return (z, w) of the unit quaternion of a heading; x and y are 0."""
    return math.sin(0.5 * psi), math.cos(0.5 * psi)


def quaternion_to_heading(z: float, w: float) -> float:
    """Return the heading in (-pi, pi] of a rotation about z."""
    return wrap_angle(2.0 * math.atan2(z, w))


def quaternions_to_headings(z: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Return `quaternion_to_heading` of rotations (n,), with the same bits."""
    # math.atan2, as every receiver of a message uses: numpy's may differ in the last bit
    psi = 2.0 * np.fromiter(map(math.atan2, z.tolist(), w.tolist()), float, len(z))
    turned = np.abs(psi) > math.pi
    psi[turned] -= np.copysign(math.tau, psi[turned])  # exact, as the remainder is
    psi[psi == -math.pi] = math.pi
    return psi


def value_to_text(value: float | int | str | bool) -> str:
    """Return a text that `text_to_value` turns into the same value.

    Raises ValueError for a word that would come back as something else, such as '12'.
    """
    if isinstance(value, str):
        if not isinstance(text_to_value(value), str):
            raise ValueError(f'the word {value!r} would be read as a number or truth')
        return value
    plain = value.item() if isinstance(value, np.generic) else value
    return repr(plain)


def text_to_value(text: str) -> float | int | str | bool:
    """Return the number or boolean that a text spells, else the text; infinity beyond a float."""
    if text in _BOOLEANS:
        return _BOOLEANS[text]
    for kind in (int, float):
        try:
            number = kind(text)
            float(number)
        except (ValueError, OverflowError):
            continue
        return number
    return text


# A heading passes through a quaternion, a time through whole nanoseconds. With these functions a
# simulation in one process computes with the same bits as one whose values pass through messages.


def heading_as_received(psi: float) -> float:
    """Return the heading that a receiver decodes, to the last bit."""
    return quaternion_to_heading(*heading_to_quaternion(psi))


def headings_as_received(psi: np.ndarray) -> np.ndarray:
    """Return `heading_as_received` of headings (n,), with the same bits."""
    half = (0.5 * psi).tolist()
    z, w = (np.fromiter(map(function, half), float, len(half)) for function in (math.sin, math.cos))
    return quaternions_to_headings(z, w)


def odometry_as_received(x: VehicleState | EstimatedState) -> VehicleState | EstimatedState:
    """Return decode.odometry(encode.odometry(x)), or the same of an estimate."""
    return x._replace(psi=heading_as_received(x.psi))


def reference_as_received(x: Reference | Prediction) -> Reference | Prediction:
    """Return decode.reference(encode.reference(x)), or the same of a prediction."""
    since_ns = np.round(np.asarray(x.t, float) * NS_PER_S)
    return x._replace(psi=np.unwrap(headings_as_received(x.psi)), t=since_ns / NS_PER_S)


prediction_as_received = reference_as_received


def stop_plan_as_received(x: StopPlan) -> StopPlan:
    """Return decode.stop_plan(encode.stop_plan(x))."""
    return x._replace(t=np.round(x.t * NS_PER_S) / NS_PER_S)


def predictions_as_received(x: Predictions) -> Predictions:
    """Return decode.predictions(encode.predictions(x))."""

    def received(branch):
        numbers = (np.float32(field).astype(float) for field in branch[1:])
        probability, *arrays = numbers
        return Branch(x.stamp_ns, float(probability), *arrays)

    return x._replace(by_id={k: tuple(map(received, v)) for k, v in sorted(x.by_id.items())})
