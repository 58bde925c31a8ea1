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
    speed: float


class Stage(NamedTuple):
    obstacles: tuple
    speed: float


SCENE = Scene(Car(1.0, Pose(2.0, 3.0)), 4.0)
STAGE = Stage((Pose(1.0, 2.0), Pose(3.0, 4.0)), 5.0)


def test_leaves_come_in_field_order():
    assert named_vector.leaves(SCENE) == [1.0, 2.0, 3.0, 4.0]
    assert named_vector.leaves(STAGE) == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_a_nested_type_is_found_by_its_annotation_or_in_the_instance():
    assert named_vector.names(Scene) == ('car.mass', 'car.pose.x', 'car.pose.y', 'speed')
    assert named_vector.names(SCENE) == named_vector.names(Scene)


def test_members_of_a_plain_tuple_count_from_0():
    names = ('obstacles.0.x', 'obstacles.0.y', 'obstacles.1.x', 'obstacles.1.y', 'speed')
    assert named_vector.names(STAGE) == names


@pytest.mark.parametrize(('template', 'value'), [(Scene, SCENE), (SCENE, SCENE), (STAGE, STAGE)])
def test_building_is_the_inverse_of_leaves(template, value):
    assert named_vector.build(template, named_vector.leaves(value)) == value


@pytest.mark.parametrize('values', [range(3), range(5)])
def test_a_wrong_count_is_refused(values):
    with pytest.raises(ValueError, match='Scene has 4 numbers, got'):
        named_vector.build(Scene, values)
