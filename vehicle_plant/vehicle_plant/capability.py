"""What the actuators of a car can do together: what a controller of it must know."""

from typing import NamedTuple

from vehicle_plant.car import Car


class Capability(NamedTuple):
    """How the car is driven, and the most that its actuators do."""

    drive_front_share: float  # 0 = rear-wheel drive
    steer_rad: float  # at the road wheel, either way
    steer_rate_radps: float
    brake_n: float  # N, both axles
    drive_n: float  # N, both axles
    force_rate_nps: float  # N/s, of the slower axle


def of(car: Car) -> Capability:
    """Return what the actuators of a car do; one without a drive counts as rear-wheel drive."""
    front, rear = car.force.front, car.force.rear
    drive_n = front.drive_n + rear.drive_n
    return Capability(
        drive_front_share=front.drive_n / drive_n if drive_n else 0.0,
        steer_rad=car.steering.limit_rad,
        steer_rate_radps=car.steering.rate_radps,
        brake_n=front.brake_n + rear.brake_n,
        drive_n=drive_n,
        force_rate_nps=min(front.rate_nps, rear.rate_nps),
    )
