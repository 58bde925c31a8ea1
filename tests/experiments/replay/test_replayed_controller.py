"""The parameters of a replayed controller: recorded, newer, set, and those of another car."""

import dataclasses
import json

import pytest

from bags.errors import BagError, OlderRunWarning
from experiments.configuration import set_option
from experiments.replay import replayed_controller
from mpcc_controller.parameters import CarParams
from node_runtime import node_parameters, parameters

CAR_FILE = node_parameters.find_config('mpcc_controller', 'car.yaml')


@pytest.fixture(scope='module')
def run_info(mpcc):
    return mpcc.run_info


def params_of(run_info, **settings):
    """Return the parameters and the car of a run with some settings."""
    return replayed_controller.recorded_params(run_info, settings, 'mpcc')


def without(run_info, name):
    """Return a run that lacks a parameter of the controller."""
    noted = json.loads(run_info['parameters'])
    del noted['controller'][name]
    return run_info | {'parameters': json.dumps(noted)}


@pytest.fixture
def own_car(tmp_path):
    """Return a function that writes a car file in which a text is replaced."""

    def write(before, after):
        path = tmp_path / 'my_car.yaml'
        path.write_text(CAR_FILE.read_text().replace(before, after))
        return str(path)

    return write


def test_run_information_without_parameters_is_refused():
    with pytest.raises(BagError, match='does not say the parameters'):
        replayed_controller.from_run_info({}, {}, 'mpcc')


def test_a_parameter_that_an_older_run_lacks_is_named_and_takes_its_default(run_info):
    with pytest.warns(OlderRunWarning, match=r'assumed: tolerances\.lag_m = 0\.5'):
        made, _ = params_of(without(run_info, 'tolerances.lag_m'))
    assert made == params_of(run_info)[0]


def test_a_parameter_of_the_car_that_the_run_lacks_is_an_error(run_info):
    with pytest.raises(BagError, match=r'tyre\.front_friction: is missing'):
        params_of(without(run_info, 'tyre.front_friction'))


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('plant.friction=0.5', 'only parameters of the controller'),
        ('controller.tolerances.lag_m', r'must be \[controller\.\]parameter=value'),
        ('weights.lag=0', r'experiments resolve.*controller\.tolerances'),
    ],
)
def test_a_setting_of_another_form_is_refused(text, expected):
    with pytest.raises(BagError, match=expected):
        set_option.parse_controller_settings([text])


def test_a_parameter_of_the_controller_needs_no_node_before_it():
    texts = ['solver.mode=one_step', 'controller.tolerances.lag_m=4e-1']
    values = {'solver.mode': 'one_step', 'tolerances.lag_m': 0.4}
    assert set_option.parse_controller_settings(texts) == values


def test_a_misspelt_setting_is_refused_with_the_closest_parameter(run_info):
    with pytest.raises(BagError, match=r"^--set: solver\.mdoe: .* did you mean 'solver\.mode'\?"):
        params_of(run_info, **{'solver.mdoe': 'one_step'})


def test_a_limit_that_the_car_would_cut_is_refused(run_info):
    noted = json.loads(run_info['parameters'])
    car = parameters.read_file(CAR_FILE).values
    noted['controller'] |= {n: v for n, v in car.items() if n.startswith('actuators.')}
    newer = run_info | {'parameters': json.dumps(noted)}
    params_of(newer, **{'limits.steer_rate_radps': 0.8})
    with pytest.raises(BagError, match=r'limits\.steer_rate_radps: is 0\.9; allowed up to 0\.8'):
        params_of(newer, **{'limits.steer_rate_radps': 0.9})


def test_a_car_file_replaces_the_car_of_the_run_and_single_settings_win_over_it(run_info, own_car):
    own, shipped = (
        own_car('mass_kg: 1850.0', 'mass_kg: 1234.0'),
        parameters.load(CarParams, CAR_FILE),
    )
    params, vehicle = params_of(run_info, car_file=own)
    assert params.car_file == own
    assert params_of(run_info)[1].car.mass_kg == 1850.0
    lighter = dataclasses.replace(shipped.car, mass_kg=1234.0)
    assert vehicle == dataclasses.replace(shipped, car=lighter)
    _, vehicle = params_of(run_info, **{'car_file': own, 'car.mass_kg': 1500.0})
    assert vehicle.car.mass_kg == 1500.0


@pytest.mark.parametrize('name', ['nosuch.yaml', './nosuch.yaml', 'mpcc.yaml', 1])
def test_a_car_file_that_cannot_be_used_is_refused_with_its_name(run_info, name):
    with pytest.raises(BagError, match=rf'^--set.*car_file.*{name}'):
        params_of(run_info, car_file=name)


@pytest.mark.parametrize('name', ['tolerances.lag', 'tyre.front', 'nothing'])
def test_a_setting_that_does_not_exist_is_refused(run_info, name):
    with pytest.raises(BagError, match=name):
        replayed_controller.from_run_info(run_info, {name: 1.0}, 'mpcc')
