"""Loading the parameters of the car, and the limits that its actuators set."""

import dataclasses

import pytest

from mpcc_controller import car_file, in_force
from mpcc_controller.problem import stage_parameters
from msgs_yaml import share
from node_runtime.parameters import ParameterError


def replace(owner, group, **values):
    """Return owner with other values in one of its groups."""
    changed = dataclasses.replace(getattr(owner, group), **values)
    return dataclasses.replace(owner, **{group: changed})


@pytest.fixture(scope='module')
def shipped(params):
    return car_file.load(params)


def test_a_bare_name_is_a_file_in_config_and_anything_else_a_path(params, shipped, tmp_path):
    text = share.path('mpcc_controller', 'config', 'car.yaml').read_text()
    own = tmp_path / 'own.yaml'
    elsewhere = dataclasses.replace(params, car_file=str(own))
    own.write_text(text)
    assert car_file.load(elsewhere) == shipped
    own.write_text(text.replace('mass_kg', 'mas_kg'))
    with pytest.raises(ParameterError, match='mas_kg'):
        car_file.load(elsewhere)
    with pytest.raises(ParameterError, match=r'car_file: .*has car\.yaml.*\./nosuch\.yaml'):
        car_file.load(dataclasses.replace(params, car_file='nosuch.yaml'))


@pytest.mark.parametrize(('given', 'used'), [(None, 1.0), (0.0, 0.0), (0.4, 0.4)])
def test_the_drive_layout_is_that_of_the_car_unless_the_controller_has_its_own(
    params, shipped, given, used
):
    vehicle = replace(shipped, 'actuators', drive_front_share=1.0)
    params = replace(params, 'model', drive_front_share=given)
    assert stage_parameters.car(params, vehicle).lambda_d == used


def test_the_lags_of_the_actuators_are_in_the_model_where_the_switch_is_on(params, vehicle):
    car, lagging = (
        stage_parameters.car(replace(params, 'model', servo_lag=on), vehicle)
        for on in (False, True)
    )
    assert (car.steer_lag, car.force_lag) == (0.0, 0.0)
    actuators = vehicle.actuators
    assert (lagging.steer_lag, lagging.force_lag) == (actuators.steer_lag_s, actuators.force_lag_s)
    older = replace(vehicle, 'actuators', force_lag_s=None)
    with pytest.raises(ParameterError, match=r'does not have actuators\.force_lag_s'):
        stage_parameters.car(replace(params, 'model', servo_lag=True), older)


def test_limits_are_cut_to_what_the_car_can_do_and_not_raised(params, shipped):
    assert car_file.limit_to_car(params, shipped) == params
    assert in_force.describe_changes(params, shipped) == []
    weak = replace(shipped, 'actuators', steer_rate_radps=0.349, drive_n=4000.0)
    cut = car_file.limit_to_car(params, weak)
    assert cut == replace(params, 'limits', steer_rate_radps=0.349, drive_n=4000.0)
    assert in_force.describe_changes(params, weak)[0].endswith(
        'car.yaml can do; cut: limits.steer_rate_radps from 0.524 to 0.349, '
        'limits.drive_n from 6000 to 4000'
    )


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


def test_a_car_whose_force_changes_slowly_may_be_driven_so(params, vehicle):
    slow = replace(vehicle, 'actuators', force_rate_nps=20000.0)
    car_file.check_emergency_limits(replace(params, 'limits', force_rate_nps=10000.0), slow)
    too_slow = replace(params, 'limits', force_rate_nps=9999.0)
    with pytest.raises(ParameterError, match=r'allowed from 10000, 0\.5 of what the car can do'):
        car_file.check_emergency_limits(too_slow, slow)


def test_only_a_limit_that_a_user_set_beyond_the_car_is_refused(params, shipped):
    weak = replace(shipped, 'actuators', drive_n=1.0, brake_n=2.0)
    car_file.check_limits(params, weak, {'limits.steer_rad': 'mine.yaml'})
    with pytest.raises(ParameterError, match=r'^mine.yaml: limits.drive_n: is 6000; allowed up to'):
        car_file.check_limits(params, weak, {'limits.drive_n': 'mine.yaml'})
