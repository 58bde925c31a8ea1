"""The estimator of a drive: its parameters, from the car and its sensors, and it in process."""

from collections.abc import Iterable
from typing import Any

from bags.errors import BagError
from mpcc_controller.parameters import CarParams, Tyre
from msgs_yaml.types import VehicleState
from node_runtime import parameters
from state_estimator import estimators
from state_estimator.estimate import Estimate
from state_estimator.parameters import EstimatorParams, Vehicle
from vehicle_plant import suspension
from vehicle_plant.car import Car
from vehicle_plant.sensors import Reading, SensorParams
from vehicle_plant.simulator import STEP_NS, TICK_NS

RELAXATION_M = 0.5  # of a passenger tyre, a wheel's radius to two of them
SLIP_PER_MPS2 = 0.004  # a tyre that slips by 4 % at 1 g


def known_values(sensors: SensorParams, friction: float, car: Vehicle) -> dict[str, Any]:
    """Return the parameters that follow from the sensors' data sheets and the car, by dotted name.

    friction: that the controller believes. Raises BagError for an IMU that has no message at an
    instant at which the controller is to know the state.
    """
    imu, chassis, receiver = sensors.imu, sensors.chassis, sensors.receiver
    if TICK_NS % (imu.period_ms * STEP_NS):
        raise BagError(
            f'the sensors: imu.period_ms is {imu.period_ms}; allowed 1, 2, 5 or 10 ms: the '
            'controller is to know the state every 50 ms'
        )
    return {
        'imu_s': imu.period_ms / 1000,
        'chassis_s': chassis.period_ms / 1000,
        'fix_s': receiver.period_ms / 1000,
        'acceleration_bias_mps2': imu.acceleration_bias_mps2,
        'acceleration_noise': imu.acceleration_noise,
        'acceleration_walk': imu.acceleration_walk,
        'rate_bias_radps': imu.rate_bias_radps,
        'rate_noise': max(imu.rate_noise, 1e-5),
        'rate_walk': imu.rate_walk,
        'steer_error_rad': max(chassis.steer_bias_rad, 0.001),
        'wheel_error': max(1.5 * chassis.radius_error, 0.001),
        'position_noise_m': max(receiver.position_noise_m, 0.005),
        'position_drift_m': receiver.position_drift_m,
        'velocity_noise_mps': max(receiver.velocity_noise_mps, 0.005),
        'friction': friction,
        **{f'car.{name}': value for name, value in parameters.flatten(car).items()},
    }


def front_stiffness(tyre: Tyre) -> float:
    """Return that [N/rad] of the front tyre and a soft steering in series, as the filter has it."""
    return tyre.front_cornering_npr / (
        1 + (tyre.compliance_radpn or 0.0) * tyre.front_cornering_npr
    )


def vehicle(car: CarParams, plant: Car) -> Vehicle:
    """Return the car as `identify` knows it, with wheels, track, roll and pitch of the plant."""
    own, tyre = car.car, car.tyre
    roll, pitch = _steady_roll_and_pitch(plant)
    return Vehicle(
        mass_kg=own.mass_kg,
        yaw_inertia_kgm2=own.yaw_inertia_kgm2,
        front_m=own.cog_to_front_m,
        rear_m=own.cog_to_rear_m,
        cog_height_m=own.cog_height_m,
        track_m=0.5 * (plant.suspension.front.track_m + plant.suspension.rear.track_m),
        wheel_radius_m=plant.wheel.radius_m,
        drive_front_share=car.actuators.drive_front_share or 0.0,
        front_cornering_npr=front_stiffness(tyre),
        rear_cornering_npr=tyre.rear_cornering_npr,
        front_friction=tyre.front_friction,
        rear_friction=tyre.rear_friction,
        relaxation_m=RELAXATION_M,
        slip_per_mps2=SLIP_PER_MPS2,
        roll_radps2=roll,
        pitch_radps2=pitch,
    )


def _steady_roll_and_pitch(car):
    """Return roll per lateral and pitch per braking deceleration [rad per m/s^2] on the springs.

    Springs of suspension and tyre in series; small angles.
    """
    roll_stiffness = pitch_stiffness = 0.0
    body = car.body
    unsprung = 2 * sum(a.unsprung_mass_kg for a in (car.suspension.front, car.suspension.rear))
    sprung, height = body.mass_kg - unsprung, body.cog_height_m
    roll_arm = pitch_arm = height
    length = body.cog_to_front_m + body.cog_to_rear_m
    for corner in suspension.wheel_corners(car):
        axle, tyre = corner.axle, car.wheel.vertical_stiffness_npm
        share = (length - abs(corner.x)) / length / 2
        roll_arm -= share * axle.roll_centre_height_m
        pitch_arm -= share * axle.pitch_centre_height_m
        rolled = axle.ride_rate_npm + 2 * axle.antiroll_npm
        roll_stiffness += corner.y**2 / (1 / rolled + 1 / tyre)
        pitch_stiffness += corner.x**2 / (1 / axle.ride_rate_npm + 1 / tyre)
    weight = sprung * body.gravity_mps2
    return (
        body.mass_kg * roll_arm / (roll_stiffness - weight * roll_arm),
        body.mass_kg * pitch_arm / (pitch_stiffness - weight * pitch_arm),
    )


class Estimator:
    """Keeps the newest estimate of the messages that arrived."""

    def __init__(self, params: EstimatorParams):
        self._estimator = estimators.create(params)
        self.estimates: list[Estimate] = []

    def read(self, readings: Iterable[Reading]) -> None:
        """Take messages in order of arrival."""
        for reading in readings:
            estimate = self._estimator.update(reading.value)
            if estimate is not None:
                self.estimates.append(estimate)

    def state(self, stamp_ns: int) -> VehicleState:
        """Return the newest state as that of an instant at which a message of the IMU is due."""
        return self.estimates[-1].state._replace(stamp_ns=stamp_ns)
