"""From a bag to what can be judged: what is refused, and in which words."""

import json

import pytest

from bags.errors import BagError, DamagedBagWarning
from bags.evaluation.drive import (
    LATERAL_LIMIT,
    NO_ACCELERATIONS,
    NO_INPUTS,
    facts_from_run_info,
)
from bags.report.comparison import compare_bags
from bags.run import load_quietly
from node_runtime import provenance

PARAMETERS = {
    'controller': {
        'body.circle_offsets_m': [1.1, -1.1],
        'body.circle_radius_m': 1.2,
        'model.step_s': 0.05,
        'safety.edge_m': 0.4,
        'safety.obstacle_m': 0.6,
        'tyre.front_friction': 0.8,
        'tyre.rear_friction': 1.0,
    },
    'plant': {
        'car.body.cog_to_front_m': 1.4,
        'car.outline.front_overhang_m': 0.8,
        'car.outline.rear_overhang_m': 1.1,
        'car.outline.width_m': 1.9,
        'car.body.cog_to_rear_m': 1.5,
        'car.suspension.front.track_m': 1.6,
        'car.suspension.rear.track_m': 1.7,
        'friction': 0.5,
        'stop.armed_after_m': 80.0,
        'stop.x_m': 165.0,
        'stop.y_m': 1.0,
    },
}


NOTE = provenance.describe_run('somewhere', 'schema: 1', 'mpcc', 'lockstep', PARAMETERS)


def test_the_judge_takes_its_distances_from_the_notes_of_the_run():
    result = facts_from_run_info(NOTE, 'bag')
    assert (result.safe_obstacle, result.safe_edge, result.vehicle_radius) == (0.6, 0.4, 1.2)
    assert result.circles == (1.1, -1.1)
    assert result.tick_ns == 50_000_000
    assert result.friction == pytest.approx(0.5 * 0.9)
    assert (result.stop, result.armed_after) == ((165.0, 1.0), 80.0)
    assert result.outline.front + result.outline.rear == pytest.approx(2.9 + 0.8 + 1.1)
    assert result.outline.width == 1.9
    assert set(result.wheels) == {(1.4, 0.8), (1.4, -0.8), (-1.5, 0.85), (-1.5, -0.85)}


def test_a_car_without_actuators_and_imu_is_judged_by_its_motion(make_drive, write_bag):
    whole = make_drive(metres=40.0)
    bare = whole._replace(inputs=NO_INPUTS, accelerations=NO_ACCELERATIONS)
    bags = [write_bag(whole, 'whole'), write_bag(bare, 'bare')]
    runs = {bag.name: dict(load_quietly(bag).metrics) for bag in bags}
    differing = {name for name, value in runs['bare'].items() if value != runs['whole'][name]}
    assert {'braking_s', 'counter_steer_s', 'peak_brake_mps2', 'peak_lat_acc_mps2'} <= differing
    assert {runs['bare'][name] for name in differing} == {None}
    assert runs['bare']['verdict'] == runs['whole']['verdict']


BROKEN = {'parameters': json.dumps({'controller': {}, 'plant': {}})}


@pytest.mark.parametrize(
    ('given', 'why'),
    [
        (None, "bag: the run does not say 'parameters'"),
        (BROKEN, r'tyre\.front_friction'),
        *(
            ({LATERAL_LIMIT: limit}, f'bag: {LATERAL_LIMIT} is {limit!r}; allowed are numbers')
            for limit in ('high', 'nan', '0.0', '-8.7')
        ),
    ],
)
def test_notes_that_do_not_say_enough_are_refused_with_what_is_missing(given, why):
    with pytest.raises(BagError, match=why):
        facts_from_run_info({} if given is None else NOTE | given, 'bag')


def test_runs_of_different_scenarios_compare_by_force_only_and_damage_is_no_warning(
    undrawn, make_drive, write_bag, tmp_path, recwarn
):
    drive = make_drive(metres=10.0)
    bags = [write_bag(drive, 'one'), write_bag(drive, 'other', text='schema: 1 # changed')]
    with pytest.raises(BagError, match=r"two versions of 'straight'.*--force"):
        compare_bags(bags, tmp_path / 'out')
    assert not (tmp_path / 'out').exists()
    (file,) = bags[0].glob('*.mcap')
    file.write_bytes(file.read_bytes()[:-9])
    compared = compare_bags(bags, tmp_path / 'out', force=True)
    assert list(compared.values['runs']) == ['one', 'other']
    assert 'cut off' in compared.values['damage']['one']
    assert not [item for item in recwarn if item.category is DamagedBagWarning]


def test_notes_name_the_versions_that_the_numbers_depend_on():
    versions = json.loads(NOTE['versions'])
    assert 'unknown' not in (versions['python'], versions['casadi'], versions['rclpy'])
