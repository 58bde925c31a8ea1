from dataclasses import dataclass
from typing import Any, NamedTuple

import pytest

from node_runtime import named_vector


class Pose(NamedTuple):
    x: Any
    y: Any


@dataclass(frozen=True)
class Car:
    mass: float
    pose: Pose


class Scene(NamedTuple):
    car: Car
    obstacles: tuple


SCENE = Scene(Car(1.0, Pose(2.0, 3.0)), (Pose(4.0, 5.0), 6.0))


def test_leaves_come_in_field_order_and_members_of_a_plain_tuple_count_from_0():
    assert named_vector.leaves(SCENE) == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    of_car = ('car.mass', 'car.pose.x', 'car.pose.y')
    assert named_vector.names(SCENE) == (*of_car, 'obstacles.0.x', 'obstacles.0.y', 'obstacles.1')
    assert named_vector.names(Car) == named_vector.names(SCENE.car) == ('mass', 'pose.x', 'pose.y')


@pytest.mark.parametrize(
    ('template', 'value'), [(SCENE, SCENE), (Car, SCENE.car), (Pose, Pose(1, 2))]
)
def test_building_is_the_inverse_of_leaves_and_takes_their_number(template, value):
    leaves = named_vector.leaves(value)
    assert named_vector.build(template, leaves) == value
    for wrong in (leaves[:-1], [*leaves, 1.0]):
        name = f'{type(value).__name__} has {len(leaves)} numbers, got {len(wrong)}'
        with pytest.raises(ValueError, match=name):
            named_vector.build(template, wrong)
