"""Parameters of the estimator: what it knows of the car, and the errors that it expects."""

from typing import Annotated

from node_runtime import parameters
from node_runtime.parameters import Choice, Range, Struct


class Vehicle(Struct):
    """The car as the estimator knows it; the tyres are those that `identify` writes."""

    mass_kg: Annotated[float, Range(300.0, 5000.0, 'kg')]
    yaw_inertia_kgm2: Annotated[float, Range(100.0, 20000.0, 'kg m^2')]
    front_m: Annotated[float, Range(0.3, 3.0, 'm')]  # CoG to the front axle
    rear_m: Annotated[float, Range(0.3, 3.0, 'm')]  # CoG to the rear axle
    cog_height_m: Annotated[float, Range(0.1, 1.5, 'm')]
    track_m: Annotated[float, Range(0.5, 3.0, 'm')]  # between the wheels of an axle
    wheel_radius_m: Annotated[float, Range(0.1, 1.0, 'm')]  # rolling
    drive_front_share: Annotated[float, Range(0.0, 1.0, '-')]  # of the driving force
    front_cornering_npr: Annotated[float, Range(1e4, 1e6, 'N/rad')]
    rear_cornering_npr: Annotated[float, Range(1e4, 1e6, 'N/rad')]
    front_friction: Annotated[float, Range(0.1, 2.0, '-')]
    rear_friction: Annotated[float, Range(0.1, 2.0, '-')]
    relaxation_m: Annotated[float, Range(0.0, 2.0, 'm')]  # of the lateral force
    slip_per_mps2: Annotated[float, Range(0.0, 0.05, 's^2/m')]  # of a wheel that brakes or drives
    roll_radps2: Annotated[float, Range(0.0, 0.05, 'rad per m/s^2')]  # steady roll
    pitch_radps2: Annotated[float, Range(0.0, 0.05, 'rad per m/s^2')]  # steady pitch


class EstimatorParams(Struct):
    """The car; standard deviations of errors, and how long they last: config/estimator.yaml."""

    method: Annotated[str, Choice('filter', 'kinematic', 'raw')]  # filter, observer, or none
    imu_s: Annotated[float, Range(0.0005, 0.05, 's')]
    chassis_s: Annotated[float, Range(0.0005, 0.1, 's')]
    fix_s: Annotated[float, Range(0.01, 2.0, 's')]
    acceleration_bias_mps2: Annotated[float, Range(0.0, 5.0, 'm/s^2')]
    acceleration_noise: Annotated[float, Range(0.0, 1.0, 'm/s^2 per root Hz')]
    acceleration_walk: Annotated[float, Range(0.0, 1.0, 'm/s^2 per root second')]
    roll_noise: Annotated[float, Range(0.0, 1.0, 'm/s^2 per root Hz')]
    pitch_noise: Annotated[float, Range(0.0, 1.0, 'm/s^2 per root Hz')]
    rate_bias_radps: Annotated[float, Range(0.0, 0.5, 'rad/s')]
    rate_noise: Annotated[float, Range(1e-6, 0.1, 'rad/s per root Hz')]
    rate_walk: Annotated[float, Range(0.0, 0.1, 'rad/s per root second')]
    roll_time_s: Annotated[float, Range(0.02, 10.0, 's')]  # from the roll rate to steady roll
    tyre_noise_mps2: Annotated[float, Range(0.01, 5.0, 'm/s^2')]  # of a force per mass
    tyre_error: Annotated[float, Range(0.0, 1.0, '-')]  # likewise, of the force
    tyre_time_s: Annotated[float, Range(0.001, 10.0, 's')]  # how long these last
    steer_error_rad: Annotated[float, Range(0.0, 0.1, 'rad')]
    force_time_s: Annotated[float, Range(0.001, 0.2, 's')]  # smoothing of ay and the yaw rate
    wheel_noise_mps: Annotated[float, Range(0.001, 2.0, 'm/s')]
    wheel_error: Annotated[float, Range(0.0, 0.2, '-')]  # of the rolling radius
    slip_error: Annotated[float, Range(0.0, 2.0, '-')]  # of the slip that is expected
    wheel_time_s: Annotated[float, Range(0.001, 10.0, 's')]  # how long these last
    position_noise_m: Annotated[float, Range(0.001, 20.0, 'm')]
    position_drift_m: Annotated[float, Range(0.0, 20.0, 'm')]
    drift_time_s: Annotated[float, Range(0.1, 1e4, 's')]
    position_walk: Annotated[float, Range(0.0, 1.0, 'm per root second')]
    velocity_noise_mps: Annotated[float, Range(0.001, 5.0, 'm/s')]
    start_sideslip_rad: Annotated[float, Range(0.0, 1.0, 'rad')]
    start_yaw_rad: Annotated[float, Range(0.0, 3.0, 'rad')]  # of a start at rest
    friction: Annotated[float, parameters.ROAD_FRICTION]  # expected, 1 = as identified
    friction_spread: Annotated[float, Range(0.0, 1.0, '-')]
    friction_time_s: Annotated[float, Range(0.1, 1000.0, 's')]  # how long it stays another
    misfit: Annotated[float, Range(1.0, 1000.0, '-')]  # of a fix, chi-square of 4
    misfits: Annotated[int, Range(1, 1000, 'in a row')]  # then the filter begins anew
    # heading of a car that starts at rest; left out: it begins when it moves
    yaw_rad: Annotated[float, Range(-7.0, 7.0, 'rad')] | None
    car: Vehicle
