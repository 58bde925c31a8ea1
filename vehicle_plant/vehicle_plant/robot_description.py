"""The car as URDF, and the frames of its parts: what /robot_description and /tf tell others.

`base_link` is the point of the road below the centre of gravity, x forward, y left, z up: the frame
of /vehicle/odometry. Its children are `body`, in the centre of gravity, and the four wheels, in
their centres. The front wheels turn with the joint `steer`, which /vehicle/actuators names, too.
The body and the width of a wheel are for the eye: the car file has neither.
"""

import math
from typing import NamedTuple
from xml.etree import ElementTree

from msgs_yaml import contract
from vehicle_plant.car import Car

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
    body, z = car.body, car.wheel.radius_m
    front, rear = body.cog_to_front_m, -body.cog_to_rear_m
    half_front, half_rear = car.suspension.front.track_m / 2, car.suspension.rear.track_m / 2
    return (
        Frame(BODY, 0.0, 0.0, body.cog_height_m),
        Frame('fl_wheel', front, half_front, z, True),
        Frame('fr_wheel', front, -half_front, z, True),
        Frame('rl_wheel', rear, half_rear, z),
        Frame('rr_wheel', rear, -half_rear, z),
    )


def urdf(car: Car, name: str = 'car') -> str:
    """Return the URDF of a car: links, joints, mass, outline; an XML text in SI units.

    Mass and inertias are those of the whole car, in `body`; the collision shape is the outline.
    """
    robot = ElementTree.Element('robot', name=name)
    for material, rgba in COLOURS.items():
        element = ElementTree.SubElement(robot, 'material', name=material)
        ElementTree.SubElement(element, 'color', rgba=rgba)
    ElementTree.SubElement(robot, 'link', name=BASE)
    for frame in frames(car):
        link = ElementTree.SubElement(robot, 'link', name=frame.name)
        if frame.name == BODY:
            _fill_body(link, car)
        else:
            _fill_wheel(link, car)
        _add_joint(robot, frame, car)
    ElementTree.indent(robot)
    return f'<?xml version="1.0"?>\n{ElementTree.tostring(robot, encoding="unicode")}\n'


def _fill_body(link, car):
    body, outline = car.body, car.outline
    inertial = ElementTree.SubElement(link, 'inertial')
    ElementTree.SubElement(inertial, 'mass', value=_numbers(body.mass_kg))
    moments = body.roll_inertia_kgm2, body.pitch_inertia_kgm2, body.yaw_inertia_kgm2
    inertia = {'ixy': '0', 'ixz': '0', 'iyz': '0'}
    inertia |= {axis: _numbers(value) for axis, value in zip(('ixx', 'iyy', 'izz'), moments)}
    ElementTree.SubElement(inertial, 'inertia', inertia)
    nose = body.cog_to_front_m + outline.front_overhang_m
    tail = -body.cog_to_rear_m - outline.rear_overhang_m
    size = nose - tail, outline.width_m, BODY_HEIGHT_M - CLEARANCE_M
    centre = (nose + tail) / 2, 0.0, (BODY_HEIGHT_M + CLEARANCE_M) / 2 - body.cog_height_m
    for kind in ('visual', 'collision'):
        shape = ElementTree.SubElement(link, kind)
        ElementTree.SubElement(shape, 'origin', xyz=_numbers(*centre))
        geometry = ElementTree.SubElement(shape, 'geometry')
        ElementTree.SubElement(geometry, 'box', size=_numbers(*size))
    ElementTree.SubElement(link.find('visual'), 'material', name=PAINT)


def _fill_wheel(link, car):
    shape = ElementTree.SubElement(link, 'visual')
    # the axis of a URDF cylinder is z, that of a wheel is y
    ElementTree.SubElement(shape, 'origin', xyz='0 0 0', rpy=_numbers(math.pi / 2, 0.0, 0.0))
    geometry = ElementTree.SubElement(shape, 'geometry')
    size = {'radius': _numbers(car.wheel.radius_m), 'length': _numbers(TYRE_WIDTH_M)}
    ElementTree.SubElement(geometry, 'cylinder', size)
    ElementTree.SubElement(shape, 'material', name=RUBBER)


def _add_joint(robot, frame, car):
    name = f'{frame.name}_mount'
    if frame.is_steered:
        name = STEER if frame.name.startswith('fl') else MIMIC
    kind = 'revolute' if frame.is_steered else 'fixed'
    joint = ElementTree.SubElement(robot, 'joint', name=name, type=kind)
    ElementTree.SubElement(joint, 'parent', link=BASE)
    ElementTree.SubElement(joint, 'child', link=frame.name)
    ElementTree.SubElement(joint, 'origin', xyz=_numbers(frame.x, frame.y, frame.z))
    if not frame.is_steered:
        return
    ElementTree.SubElement(joint, 'axis', xyz='0 0 1')
    angle, rate = car.steering.limit_rad, car.steering.rate_radps
    limits = {'lower': -angle, 'upper': angle, 'velocity': rate, 'effort': 0.0}
    limits = {key: _numbers(value) for key, value in limits.items()}
    ElementTree.SubElement(joint, 'limit', limits)
    if name == MIMIC:
        ElementTree.SubElement(joint, 'mimic', joint=STEER)


def _numbers(*values):
    return ' '.join(f'{value:.9g}' for value in values)
