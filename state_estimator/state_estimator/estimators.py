"""The estimators by the name that the parameter `method` has, and the stream of messages to one."""

from msgs_yaml.types import Gnss, Inertial, SensorReading
from state_estimator.estimate import Estimate
from state_estimator.filter import Filter
from state_estimator.parameters import EstimatorParams
from state_estimator.references import KinematicObserver, Raw

BY_METHOD = {'filter': Filter, 'kinematic': KinematicObserver, 'raw': Raw}


def create(params: EstimatorParams) -> Filter | Raw:
    """Return an estimator without a state."""
    return BY_METHOD[params.method](params, params.car, params.yaw_rad)


class Stream:
    """An estimator on what a node hears: messages may be repeated, and another drive may begin.

    estimate   the newest, None before the first one of a drive
    resets     how often the estimator began anew within a drive, and `reason` of the last time
    is_held    whether the car is held at its start at speed, where time goes on and it does not:
               then every fix begins a drive
    """

    def __init__(self, params: EstimatorParams):
        self._params, self.is_held = params, False
        self.begin()

    def begin(self) -> None:
        """Forget everything: another drive begins."""
        self._estimator = create(self._params)
        self._newest_ns: dict[type, int] = {}
        self.estimate: Estimate | None = None

    @property
    def resets(self) -> int:
        """How often the estimator began anew within this drive."""
        return self._estimator.resets

    @property
    def reason(self) -> str:
        """Why it began anew the last time."""
        return self._estimator.reason

    def take(self, message: SensorReading) -> Estimate | None:
        """Take a message; return the estimate after one of the IMU, once there is a state.

        One that repeats the last of its kind changes nothing. One that is older begins a drive.
        """
        kind, stamp_ns = type(message), message.stamp_ns
        before_ns = self._newest_ns.get(kind, 0)
        if stamp_ns == before_ns and (kind is not Inertial or self.estimate):
            return self.estimate if kind is Inertial else None
        if stamp_ns < before_ns or (self.is_held and kind is Gnss):
            self.begin()
        self._newest_ns[kind] = stamp_ns
        estimate = self._estimator.update(message)
        if kind is Inertial:
            self.estimate = estimate
        return estimate
