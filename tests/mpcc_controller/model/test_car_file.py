"""Where the numbers of the car come from."""

import dataclasses

import pytest

from mpcc_controller import car_file
from msgs_yaml import share
from msgs_yaml.parameters import ParameterError


def test_a_bare_name_is_a_file_of_config_and_anything_else_a_path(params, tmp_path):
    shipped = car_file.load(params)
    assert shipped.car.mass_kg > 1000
    text = share.path('mpcc_controller', 'config', 'car.yaml').read_text()
    own = tmp_path / 'own.yaml'
    own.write_text(text)
    assert car_file.load(dataclasses.replace(params, car_file=str(own))) == shipped
    own.write_text(text.replace('mass_kg', 'mas_kg'))
    with pytest.raises(ParameterError, match='mas_kg'):
        car_file.load(dataclasses.replace(params, car_file=str(own)))


def test_the_identified_car_understeers(params):
    vehicle = car_file.load(params)
    front = vehicle.tyre.front_cornering_npr * vehicle.car.cog_to_front_m
    rear = vehicle.tyre.rear_cornering_npr * vehicle.car.cog_to_rear_m
    assert front < rear
