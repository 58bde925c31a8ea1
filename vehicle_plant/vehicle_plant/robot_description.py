"""The car as URDF, and the frames of its parts: what /robot_description and /tf tell others.

`base_link` is the point of the road below the centre of gravity, x forward, y left, z up: the frame
of /vehicle/odometry. Its children are `body`, in the centre of gravity, and the four wheels, in
their centres. The front wheels turn with the joint `steer`, which /vehicle/actuators names, too.
The body and the width of a wheel are for the eye: the car file has neither.
"""

import math
from typing import NamedTuple

from msgs_yaml import contract
from msgs_yaml.types import WHEELS
from vehicle_plant.car import Car
from vehicle_plant.suspension import wheel_corners

BASE, BODY = contract.load().topics['/vehicle/odometry'].child_frame, 'body'
STEER, MIMIC = contract.load().topics['/controller/command'].joints[0], 'fr_steer'
BODY_HEIGHT_M, CLEARANCE_M = 1.4, 0.15  # drawn: height of the roof and of the floor over the road
TYRE_WIDTH_M = 0.22  # drawn
PAINT, RUBBER = 'paint', 'rubber'
COLOURS = {PAINT: '0.35 0.4 0.45 0.9', RUBBER: '0.1 0.1 0.1 1'}  # red green blue opacity


class Frame(NamedTuple):
    """A part of the car: its place in `base_link` (m), and whether it turns with the steering."""

    name: str
    x: float
    y: float
    z: float
    is_steered: bool = False


def frames(car: Car) -> tuple[Frame, ...]:
    """Return the frames of body and wheels (fl fr rl rr) of a car at rest."""
    wheels = (
        Frame(f'{name}_wheel', c.x, c.y, car.wheel.radius_m, is_steered=c.x > 0)
        for name, c in zip(WHEELS, wheel_corners(car))
    )
    return (Frame(BODY, 0.0, 0.0, car.body.cog_height_m), *wheels)


def urdf(car: Car) -> str:
    """Return the URDF of a car: links, joints, mass, outline; an XML text in SI units.

    Mass and inertias are those of the whole car, in `body`; the collision shape is the outline.
    """
    body, outline, steering = car.body, car.outline, car.steering
    nose = body.cog_to_front_m + outline.front_overhang_m
    tail = -body.cog_to_rear_m - outline.rear_overhang_m
    centre = (nose + tail) / 2, 0.0, (BODY_HEIGHT_M + CLEARANCE_M) / 2 - body.cog_height_m
    box = f"""<origin xyz="{_numbers(*centre)}"/><geometry>
      <box size="{_numbers(nose - tail, outline.width_m, BODY_HEIGHT_M - CLEARANCE_M)}"/>
    </geometry>"""
    body_link = f"""<inertial>
      <mass value="{body.mass_kg:.9g}"/>
      <inertia ixx="{body.roll_inertia_kgm2:.9g}" iyy="{body.pitch_inertia_kgm2:.9g}"
               izz="{body.yaw_inertia_kgm2:.9g}" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual>{box}<material name="{PAINT}"/></visual>
    <collision>{box}</collision>"""
    # the axis of a URDF cylinder is z, that of a wheel is y
    wheel_link = f"""<visual><origin xyz="0 0 0" rpy="{_numbers(math.pi / 2, 0.0, 0.0)}"/>
      <geometry><cylinder radius="{car.wheel.radius_m:.9g}" length="{TYRE_WIDTH_M}"/></geometry>
      <material name="{RUBBER}"/>
    </visual>"""
    limit = f"""<limit lower="{-steering.limit_rad:.9g}" upper="{steering.limit_rad:.9g}"
           velocity="{steering.rate_radps:.9g}" effort="0"/>"""
    parts = [f'<material name="{m}"><color rgba="{c}"/></material>' for m, c in COLOURS.items()]
    parts.append(f'<link name="{BASE}"/>')
    for frame in frames(car):
        link = body_link if frame.name == BODY else wheel_link
        joint, kind, turn = f'{frame.name}_mount', 'fixed', ''
        if frame.is_steered:
            kind, turn = 'revolute', f'<axis xyz="0 0 1"/>{limit}'
            joint = STEER if frame.name.startswith('fl') else MIMIC
            turn += f'<mimic joint="{STEER}"/>' if joint == MIMIC else ''
        parts += [
            f'<link name="{frame.name}">{link}</link>',
            f"""<joint name="{joint}" type="{kind}">
    <parent link="{BASE}"/><child link="{frame.name}"/>
    <origin xyz="{_numbers(frame.x, frame.y, frame.z)}"/>{turn}
  </joint>""",
        ]
    content = '\n  '.join(parts)
    return f'<?xml version="1.0"?>\n<robot name="car">\n  {content}\n</robot>\n'


def _numbers(*values):
    return ' '.join(f'{value:.9g}' for value in values)
