"""Warnings before a run: speeds at which the controller stops, an axle that is not driven."""

import re

import pytest
import yaml

from bags.errors import BagError
from experiments.configuration import inputs, node_config, run_advice
from msgs_yaml import share
from scenario_publisher import scenario


@pytest.fixture
def find_warnings(tmp_path):
    """Return find_warnings(scenario changes, settings): the warnings about a run of mpcc."""

    def find_warnings(changes, settings=None):
        own = yaml.safe_load(scenario.load('straight').text) | {'name': 'own'}
        document = own | changes
        (tmp_path / 'own.yaml').write_text(yaml.safe_dump(document))
        scn = inputs.load_scenario(str(tmp_path / 'own.yaml'))
        facts = inputs.scenario_facts(scn, str(tmp_path / 'own.yaml'))
        chosen = node_config.find_controller('mpcc')
        nodes = node_config.build_nodes(
            facts, chosen, 'lockstep', tmp_path, tmp_path, settings or {}
        )
        return run_advice.find_warnings(scn, facts, inputs.check_parameters(nodes))

    return find_warnings


def test_inputs_that_match_give_no_warning(find_warnings):
    assert find_warnings({}) == []
    assert find_warnings({'start': {'progress_m': 0.0, 'speed_mps': 7.3}}) == []
    assert find_warnings({'speed': {'constant_mps': 7.6}}) == []


@pytest.mark.parametrize(
    ('start', 'desired', 'expected'),
    [
        (7.0, 15.0, 'the car starts at 7 m/s (start.speed_mps), at or just above the'),
        (15.0, 7.0, 'the scenario asks for 7 m/s (speed.constant_mps), at or just above the'),
        (15.0, 7.4, 'the scenario asks for 7.4 m/s (speed.constant_mps), at or just above the'),
    ],
)
def test_the_least_speed_itself_gives_a_warning(find_warnings, start, desired, expected):
    changes = {'start': {'progress_m': 0.0, 'speed_mps': start}}
    (warning,) = find_warnings(changes | {'speed': {'constant_mps': desired}})
    assert warning.startswith(expected)
    assert 'so the car may ' in warning
    assert 'limits.least_speed_mps of 7 m/s' in warning


def test_a_start_speed_that_is_set_is_checked_instead_of_the_scenarios(find_warnings):
    (warning,) = find_warnings({}, {'plant': {'start.speed_mps': 5.0}})
    assert 'starts at 5 m/s (plant.start.speed_mps), below' in warning
    slow = {'start': {'progress_m': 0.0, 'speed_mps': 5.0}}
    assert find_warnings(slow, {'plant': {'start.speed_mps': 15.0}}) == []


def test_a_start_below_the_least_speed_is_named_with_key_value_and_limit(find_warnings):
    (warning,) = find_warnings({'start': {'progress_m': 0.0, 'speed_mps': 5.0}})
    assert 'starts at 5 m/s (start.speed_mps)' in warning
    assert 'limits.least_speed_mps of 7 m/s' in warning
    assert 'does not pull away' in warning


def test_the_least_speed_of_the_controller_decides(find_warnings):
    slow = {'start': {'progress_m': 0.0, 'speed_mps': 6.5}}
    assert find_warnings(slow, {'controller': {'limits.least_speed_mps': 6.0}}) == []


def test_a_least_speed_that_the_prediction_of_the_car_does_not_allow_is_named(find_warnings):
    slow = {'start': {'progress_m': 0.0, 'speed_mps': 6.5}}
    (warning,) = find_warnings(slow, {'controller': {'limits.least_speed_mps': 4.0}})
    assert 'limits.least_speed_mps is 5.5 instead of 4' in warning


def test_desired_speeds_below_the_least_one_are_named_by_the_lowest(find_warnings):
    (warning,) = find_warnings({'speed': {'constant_mps': 6.5}})
    assert 'asks for 6.5 m/s (speed.constant_mps), below' in warning
    start = {'progress_m': 0.0, 'speed_mps': 15.0}
    table = {'stations_m': [0.0, 30.0, 50.0], 'speeds_mps': [15.0, 6.0, 5.5]}
    (warning,) = find_warnings({'speed': table, 'start': start})
    assert 'asks for 5.5 m/s (speed.speeds_mps[2] and 1 more)' in warning


def test_another_driven_axle_of_the_plant_gives_a_warning_until_the_controller_has_it(
    find_warnings, tmp_path
):
    gti = {'plant': {'plant_params': 'vw_gti.yaml'}}
    (warning,) = find_warnings({}, gti)
    assert '0% of the drive is at the front axle (car_file car.yaml)' in warning
    assert 'the plant has 100% there' in warning
    assert find_warnings({}, gti | {'controller': {'model.drive_front_share': 1.0}}) == []
    text = share.path('mpcc_controller', 'config', 'car.yaml').read_text()
    mine = tmp_path / 'my_car.yaml'
    mine.write_text(text.replace('drive_front_share: 0.0', 'drive_front_share: 1.0'))
    assert find_warnings({}, gti | {'controller': {'car_file': str(mine)}}) == []
    (warning,) = find_warnings(
        {}, gti | {'controller': {'car_file': str(mine), 'model.drive_front_share': 0.5}}
    )
    assert '50% of the drive is at the front axle (model.drive_front_share)' in warning


@pytest.fixture
def check_car(tmp_path):
    """Return check_car(settings): what is wrong with the controller's car, '' if it fits."""

    def check_car(plant=None, **controller):
        facts, chosen = inputs.load_facts('straight'), node_config.find_controller('mpcc')
        settings = {'plant': plant or {}, 'controller': controller}
        nodes = node_config.build_nodes(facts, chosen, 'lockstep', tmp_path, tmp_path, settings)
        try:
            inputs.check_car_fits(nodes, inputs.check_parameters(nodes))
        except BagError as error:
            return str(error)
        return ''

    return check_car


def test_a_car_that_fits_is_accepted(check_car):
    assert check_car() == ''
    assert check_car({'car.body.mass_kg': 1850.0 * 1.2}) == ''
    second = {'plant_params': 'bmw_320i.yaml'}
    assert check_car(second, car_file='car_commonroad_320i.yaml') == ''


def test_the_car_of_another_plant_is_refused_with_each_reason(check_car):
    error = check_car({'plant_params': 'vw_gti.yaml'})
    assert (
        'car_file car.yaml does not fit the plant: wheelbase 2.89 m, the plant has 2.63 m' in error
    )
    assert '0% of the drive at the front axle, the plant has 100%' in error
    assert 'identify --car' in error
    assert 'mass 1850 kg, the plant has 1093' in check_car({'plant_params': 'bmw_320i.yaml'})
    assert 'mass' in check_car({'car.body.mass_kg': 1500.0})
    assert 'allowed within 20%' in check_car({'car.body.mass_kg': 1500.0})


def test_masses_and_axle_loads_of_a_file_fit_within_5_percent(check_car, tmp_path):
    plant = share.path('vehicle_plant', 'config', 'bmw_545i.yaml').read_text()

    def check(name, **values):
        text = plant
        for key, value in values.items():
            text, count = re.subn(rf'{key}: [0-9.]+', f'{key}: {value}', text, count=1)
            assert count == 1
        file = tmp_path / f'{name}.yaml'
        file.write_text(text)
        return check_car({'plant_params': str(file), **others})

    others = {}
    assert check('light', mass_kg=1770.0) == ''
    assert 'mass 1850 kg, the plant has 1750 kg' in check('lighter', mass_kg=1750.0)
    nose_heavy = check('nose', cog_to_front_m=1.34, cog_to_rear_m=1.55)
    assert 'plant: load of the front axle 934.6 kg, the plant has 992.2 kg' in nose_heavy
    assert 'load of the rear axle 915.4 kg, the plant has 857.8 kg' in nose_heavy
    # another parameter of the car that is set by its name does not loosen the check
    others = {'car.body.air_density_kgpm3': 1.1}
    assert 'mass 1850 kg, the plant has 1750 kg' in check('lighter', mass_kg=1750.0)


def test_a_drive_layout_of_the_controllers_own_is_deliberate(check_car):
    driven = {'car.force.front.drive_n': 7000.0, 'car.force.rear.drive_n': 0.0}
    assert 'the plant has 100%' in check_car(driven)
    assert check_car(driven, **{'model.drive_front_share': 0.0}) == ''


def test_limits_beyond_the_car_are_named_with_the_values_in_force(find_warnings, tmp_path):
    text = share.path('mpcc_controller', 'config', 'car.yaml').read_text()
    text = text.replace('steer_rate_radps: 0.8', 'steer_rate_radps: 0.349')
    weak = tmp_path / 'weak.yaml'
    weak.write_text(text.replace('drive_n: 7000.0', 'drive_n: 4000.0'))
    (warning,) = find_warnings({}, {'controller': {'car_file': str(weak)}})
    assert warning == (
        f'the controller may ask for more than the car of car_file {weak} can do; cut: '
        'limits.steer_rate_radps from 0.524 to 0.349, limits.drive_n from 6000 to 4000'
    )


def test_a_limit_that_is_set_beyond_the_car_is_refused(find_warnings):
    assert find_warnings({}, {'controller': {'limits.steer_rate_radps': 0.8}}) == []
    expected = r'^--set controller\.limits\.steer_rate_radps: .* is 0\.81; allowed up to 0\.8, '
    with pytest.raises(BagError, match=expected):
        find_warnings({}, {'controller': {'limits.steer_rate_radps': 0.81}})


def test_a_speed_that_the_car_cannot_reach_is_named_with_the_one_that_it_can(find_warnings):
    fast = {'speed': {'constant_mps': 60.0}, 'start': {'progress_m': 0.0, 'speed_mps': 10.0}}
    (warning,) = [text for text in find_warnings(fast) if 'asks for up to' in text]
    drive_n = inputs.controller_params('mpcc').limits.drive_n
    assert f'with {drive_n:.0f} N of drive' in warning
    assert 'from 10 m/s the car comes to' in warning
    behind = {'stations_m': [0.0, 150.0, 160.0, 170.0], 'speeds_mps': [12.0, 12.0, 60.0, 60.0]}
    later = {'speed': behind, 'start': fast['start'], 'stop': {'progress_m': 100.0, 'time_s': 20.0}}
    assert not [text for text in find_warnings(later) if 'asks for up to' in text]
    modest = {'speed': {'constant_mps': 12.0}, 'start': {'progress_m': 0.0, 'speed_mps': 10.0}}
    assert not [text for text in find_warnings(modest) if 'asks for up to' in text]


def test_a_file_with_the_name_of_a_shipped_scenario_is_said_to_be_used(find_warnings):
    (warning,) = find_warnings({'name': 'circle_20m'})
    assert 'has the name of a scenario that comes with the package, circle_20m' in warning
    assert 'the file is used' in warning


def test_a_shipped_scenario_is_told_from_a_file_of_its_name_here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shipped = scenario.load('straight')
    assert scenario.describe_namesake('straight', shipped) == ''
    copy = tmp_path / 'straight.yaml'
    copy.write_text(shipped.text)
    assert scenario.describe_namesake('straight', shipped) == ''
    copy.write_text(shipped.text + '# mine\n')
    said = scenario.describe_namesake('straight', shipped)
    assert said.endswith(
        'not the file straight.yaml in this folder: for that one give ./straight.yaml'
    )
