"""What is said before a run of inputs that go together badly, or of which some has no effect."""

import re

import pytest
import yaml

from bags.errors import BagError
from experiments.configuration import inputs, run_advice
from msgs_yaml import share
from scenario_publisher import scenario

GTI, CAR = 'plant.plant_params=vw_gti.yaml', 'controller.car_file={folder}/{name}.yaml'
LEAST = 'limits.least_speed_mps of 7 m/s'


@pytest.fixture
def find_warnings(build, tmp_path):
    """Return find_warnings(scenario changes, settings): the warnings about a run of mpcc."""

    def find(changes, *settings):
        document = yaml.safe_load(scenario.load('straight').text) | {'name': 'own'} | changes
        source = tmp_path / 'own.yaml'
        source.write_text(yaml.safe_dump(document))
        scn = inputs.load_scenario(str(source))
        nodes = build(*settings, scenario=source)
        return run_advice.find_warnings(scn, str(source), inputs.check_parameters(nodes.values()))

    return find


def car(tmp_path, package, file, **values):
    """Write a file of a package in which numbers have other values; return its path."""
    text = share.path(package, 'config', file).read_text()
    for key, value in values.items():
        text, count = re.subn(rf'{key}: [0-9.]+', f'{key}: {value}', text, count=1)
        assert count == 1
    path = tmp_path / f'my_{file}'
    path.write_text(text)
    return path


def driven(start, desired):
    return {
        'start': {'progress_m': 0.0, 'speed_mps': start},
        'speed': desired if isinstance(desired, dict) else {'constant_mps': desired},
    }


FRONT_SHARE = 'controller.model.drive_front_share'
SLOWER = {'stations_m': [0.0, 30.0, 50.0], 'speeds_mps': [15.0, 6.0, 5.5]}
LATE = {'stations_m': [0.0, 150.0, 160.0, 170.0], 'speeds_mps': [12.0, 12.0, 60.0, 60.0]}


@pytest.mark.parametrize(
    ('changes', 'settings', 'expected'),
    [
        ({}, (), ()),
        (driven(7.3, 15.0), (), ()),
        (driven(15.0, 7.6), (), ()),
        (driven(6.5, 15.0), ('controller.limits.least_speed_mps=6.0',), ()),
        (driven(5.0, 15.0), ('plant.start.speed_mps=15.0',), ()),
        (driven(10.0, LATE) | {'stop': {'progress_m': 100.0, 'time_s': 20.0}}, (), ()),
        (driven(7.0, 15.0), (), ('starts at 7 m/s (start.speed_mps), at or just above', LEAST)),
        (driven(15.0, 7.0), (), ('asks for 7 m/s (speed.constant_mps), at or just above', LEAST)),
        (driven(5.0, 15.0), (), ('starts at 5 m/s (start.speed_mps), below', 'not pull away')),
        ({}, ('plant.start.speed_mps=5.0',), ('5 m/s (plant.start.speed_mps), below',)),
        (driven(15.0, SLOWER), (), ('5.5 m/s (speed.speeds_mps[2] and 1 more)', 'the car stops')),
        (
            driven(6.5, 15.0),
            ('controller.limits.least_speed_mps=4.0',),
            ('limits.least_speed_mps is 5.5 instead of 4',),
        ),
        (
            driven(10.0, 60.0),
            (),
            ('from 10 m/s the car comes to 22 m/s at most', '6000 N of drive'),
        ),
        ({'name': 'circle_20m'}, (), ('that comes with the package, circle_20m',)),
        ({}, (GTI,), ('0% of the drive is at the front axle (car_file car.yaml)', '100% there')),
        ({}, (GTI, f'{FRONT_SHARE}=1.0'), ()),
        ({}, (GTI, f'{FRONT_SHARE}=0.5'), ('50% of the drive is at the front axle (model.drive_',)),
    ],
    ids=str,
)
def test_what_is_rarely_meant_gives_one_warning_with_its_numbers(
    find_warnings, changes, settings, expected
):
    warnings = find_warnings(changes, *settings)
    # that of a path which ends within the horizon is of the scenario alone
    warnings = [text for text in warnings if not text.startswith('the path ends')]
    assert len(warnings) == bool(expected)
    for part in expected:
        assert part in warnings[0]


def test_a_car_file_that_knows_the_driven_axle_or_cuts_limits_decides(find_warnings, tmp_path):
    mine = car(tmp_path, 'mpcc_controller', 'car.yaml', drive_front_share=1.0)
    assert find_warnings({}, GTI, f'controller.car_file={mine}') == []
    weak = car(tmp_path, 'mpcc_controller', 'car.yaml', steer_rate_radps=0.349, drive_n=4000.0)
    assert find_warnings({}, f'controller.car_file={weak}') == [
        f'the controller may ask for more than the car of car_file {weak} can do; cut: '
        'limits.steer_rate_radps from 0.524 to 0.349, limits.drive_n from 6000 to 4000'
    ]


FRONT = ('plant.car.force.front.drive_n=7000.0', 'plant.car.force.rear.drive_n=0.0')
THIN_AIR = 'plant.car.body.air_density_kgpm3=1.1'
LIGHTER = {'mass_kg': 1750.0}
NOSE_HEAVY = {'cog_to_front_m': 1.34, 'cog_to_rear_m': 1.55}


@pytest.mark.parametrize(
    ('values', 'settings', 'reasons'),
    [
        ({}, (), ()),
        ({}, (f'plant.car.body.mass_kg={1850.0 * 1.2}',), ()),
        ({}, (*FRONT, f'{FRONT_SHARE}=0.0'), ()),
        ({}, FRONT, ('0% of the drive at the front axle, the plant has 100%',)),
        (LIGHTER, (), ('mass 1850 kg, the plant has 1750 kg', 'identify --car', '--any-car')),
        # another parameter of the car that is set by its name does not loosen the check
        (LIGHTER, (THIN_AIR,), ('mass 1850 kg, the plant has 1750 kg',)),
        (
            NOSE_HEAVY,
            (),
            ('front axle 934.6 kg, the plant has 992.2 kg', 'rear axle 915.4 kg, the'),
        ),
        ({'cog_to_rear_m': 2.0}, (), ('wheelbase 2.89 m, the plant has',)),
    ],
    ids=str,
)
def test_a_controller_that_knows_another_car_is_refused_with_each_reason(
    build, tmp_path, values, settings, reasons
):
    file = car(tmp_path, 'vehicle_plant', 'bmw_545i.yaml', **values)
    nodes = build(f'plant.plant_params={file}', *settings).values()
    checked = inputs.check_parameters(nodes)
    if not reasons:
        inputs.check_car_fits(nodes, checked)
        return
    with pytest.raises(BagError) as refused:
        inputs.check_car_fits(nodes, checked)
    for reason in ('car_file car.yaml does not fit the plant: ', *reasons):
        assert reason in str(refused.value)
