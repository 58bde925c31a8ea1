"""Loading the parameters of the car."""

import dataclasses

import pytest

from mpcc_controller import car_file
from mpcc_controller.problem import stage_parameters
from msgs_yaml import share
from node_runtime import parameters
from node_runtime.parameters import ParameterError


def test_a_bare_name_is_a_file_in_config_and_anything_else_a_path(params, tmp_path):
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


def test_a_missing_file_is_an_error_of_the_parameter(params):
    with pytest.raises(ParameterError, match=r'car_file: .*has car\.yaml.*\./nosuch\.yaml'):
        car_file.load(dataclasses.replace(params, car_file='nosuch.yaml'))


@pytest.mark.parametrize(('given', 'used'), [(None, 1.0), (0.0, 0.0), (0.4, 0.4)])
def test_the_drive_layout_is_that_of_the_car_unless_the_controller_has_its_own(params, given, used):
    vehicle = car_file.load(params)
    front = dataclasses.replace(vehicle.actuators, drive_front_share=1.0)
    vehicle = dataclasses.replace(vehicle, actuators=front)
    model = dataclasses.replace(params.model, drive_front_share=given)
    assert stage_parameters.car(dataclasses.replace(params, model=model), vehicle).lambda_d == used


def test_no_shipped_controller_overrides_the_drive_layout_of_the_car():
    for file in share.path('mpcc_controller', 'config').glob('*.yaml'):
        values = parameters.read_file(file).values
        assert values.get('car_file', 'car.yaml') == 'car.yaml'
        assert 'model.drive_front_share' not in values


def test_limits_are_cut_to_what_the_car_can_do_and_not_raised(params):
    vehicle = car_file.load(params)
    assert car_file.limit_to_car(params, vehicle) == params
    weak = dataclasses.replace(vehicle.actuators, steer_rate_radps=0.349, drive_n=4000.0)
    cut = car_file.limit_to_car(params, dataclasses.replace(vehicle, actuators=weak)).limits
    assert (cut.steer_rate_radps, cut.drive_n) == (0.349, 4000.0)
    assert dataclasses.replace(cut, steer_rate_radps=0.524, drive_n=6000.0) == params.limits
    assert car_file.exceeded_limits(params, weak) == ('steer_rate_radps', 'drive_n')


@pytest.mark.parametrize(
    ('limit', 'least'),
    [
        ('brake_n', '14000'),
        ('force_rate_nps', '28000'),
        ('steer_rad', '0.24'),
        ('steer_rate_radps', '0.4'),
        ('friction_use', '0.5'),
    ],
)
def test_limits_with_which_the_car_can_hardly_brake_or_swerve_are_refused(world, limit, least):
    """Whatever the parameters of the start are, the emergency brake has half of the car's."""
    car_file.load(world.load(**{f'limits__{limit}': float(least)})[0])
    for value in (0.0, 0.99 * float(least)):
        weak, _ = world.load(**{f'limits__{limit}': value})
        with pytest.raises(ParameterError, match=rf'^limits.{limit}: is .*; allowed from {least},'):
            car_file.load(weak)
        with pytest.raises(ParameterError, match=f'^weak.yaml: limits.{limit}: '):
            car_file.load(weak, {f'limits.{limit}': 'weak.yaml'})


def test_a_car_whose_force_changes_slowly_may_be_driven_so(world, tmp_path):
    text = share.path('mpcc_controller', 'config', 'car.yaml').read_text()
    slow = tmp_path / 'slow.yaml'
    slow.write_text(text.replace('force_rate_nps: 200000.0', 'force_rate_nps: 20000.0'))

    def load(force_rate_nps):
        params, _ = world.load(limits__force_rate_nps=force_rate_nps)
        return car_file.load(dataclasses.replace(params, car_file=str(slow)))

    assert load(10000.0).actuators.force_rate_nps == 20000.0
    with pytest.raises(ParameterError, match=r'allowed from 10000, 0\.5 of what the car can do'):
        load(9999.0)


def test_the_limits_that_the_car_cuts_are_described(params):
    vehicle = car_file.load(params)
    assert car_file.describe_cut_limits(params, vehicle) == ''
    weak = dataclasses.replace(vehicle, actuators=dataclasses.replace(vehicle.actuators, drive_n=1))
    text = car_file.describe_cut_limits(params, weak)
    assert text.endswith('car.yaml can do; cut: limits.drive_n from 6000 to 1')


def test_only_a_limit_that_a_user_set_beyond_the_car_is_refused(params):
    vehicle = car_file.load(params)
    actuators = dataclasses.replace(vehicle.actuators, drive_n=1.0, brake_n=2.0)
    weak = dataclasses.replace(vehicle, actuators=actuators)
    car_file.check_limits(params, weak, {'limits.steer_rad': 'mine.yaml'})
    with pytest.raises(ParameterError, match=r'^mine.yaml: limits.drive_n: is 6000; allowed up to'):
        car_file.check_limits(params, weak, {'limits.drive_n': 'mine.yaml'})
