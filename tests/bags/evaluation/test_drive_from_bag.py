"""From a bag to what can be judged: what is refused, and in which words."""

import json

import numpy as np
import pytest
from rclpy.serialization import serialize_message

from bags.errors import BagError, DamagedBagWarning
from bags.evaluation.drive import (
    LATERAL_LIMIT,
    NO_ACCELERATIONS,
    NO_INPUTS,
    drive_from_columns,
    facts_from_run_info,
)
from bags.report.comparison import compare_bags
from bags.run import load_quietly
from bags.storage import columns, message_filing
from bags.storage.bag_writer import BagWriter
from msgs_yaml import contract, encode
from msgs_yaml.types import VehicleState
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
        'friction': 0.5,
        'stop.armed_after_m': 80.0,
        'stop.x_m': 165.0,
        'stop.y_m': 1.0,
    },
}


@pytest.fixture
def note():
    """Return note(text): the notes of a run through a scenario of this text."""

    def note(text):
        return provenance.describe_run('somewhere', text, 'mpcc', 'lockstep', PARAMETERS)

    return note


@pytest.fixture
def make_bag(tmp_path):
    """Return make(name, run_info): a bag with a single state."""

    def make(name, run_info):
        topics = message_filing.bag_topics(contract.load(), 'lockstep')
        bag = BagWriter(tmp_path / name, topics, {'run': run_info})
        state = VehicleState(1_000_000_000, 0.0, 0.0, 0.0, 20.0, 0.0, 0.0)
        index = [topic.name for topic in topics].index('/vehicle/odometry')
        bag.write(index, state.stamp_ns, 0, serialize_message(encode.odometry(state)))
        bag.close()
        return tmp_path / name

    return make


def test_the_judge_takes_its_distances_from_the_notes_of_the_run(note):
    result = facts_from_run_info(note('schema: 1'), 'bag')
    assert (result.safe_obstacle, result.safe_edge, result.vehicle_radius) == (0.6, 0.4, 1.2)
    assert result.circles == (1.1, -1.1)
    assert result.tick_ns == 50_000_000
    assert result.friction == pytest.approx(0.5 * 0.9)
    assert (result.stop, result.armed_after) == ((165.0, 1.0), 80.0)
    assert result.outline.front + result.outline.rear == pytest.approx(2.9 + 0.8 + 1.1)
    assert result.outline.width == 1.9


@pytest.mark.parametrize('topic', ['/vehicle/odometry', '/controller/command'])
def test_two_rings_in_one_domain_are_not_judged(note, topic):
    def table(name, stamps):
        zeros = dict.fromkeys(columns.names(name), np.zeros(len(stamps)))
        return columns.Columns(**zeros | {'stamp_ns': np.array(stamps, dtype=np.int64)})

    stamps = {'/vehicle/odometry': [10, 20, 30], '/controller/command': [10, 20]}
    stamps[topic] = [10, 20, 20]
    result = {name: table(name, at) for name, at in stamps.items()}
    result |= dict.fromkeys(('/vehicle/imu', '/vehicle/actuators'))
    with pytest.raises(
        BagError, match=f'{topic} has two different messages of one stamp.*shared a ROS domain'
    ):
        drive_from_columns(result, note('schema: 1'), 'bag')


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
def test_notes_that_do_not_say_enough_are_refused_with_what_is_missing(note, given, why):
    run_info = {} if given is None else note('schema: 1') | given
    with pytest.raises(BagError, match=why):
        facts_from_run_info(run_info, 'bag')


def test_runs_of_different_scenarios_do_not_compare(note, make_bag, tmp_path):
    bags = [make_bag('one', note('schema: 1')), make_bag('other', note('schema: 1 # changed'))]
    with pytest.raises(BagError, match=r"two versions of 'somewhere'.*--force"):
        compare_bags(bags, tmp_path / 'out')
    elsewhere = note('schema: 2')
    elsewhere['scenario'] = 'elsewhere'
    with pytest.raises(BagError, match="'somewhere' and 'elsewhere'"):
        compare_bags([bags[0], make_bag('third', elsewhere)], tmp_path / 'out')
    assert not (tmp_path / 'out').exists()
    # --force goes on to what the bags hold
    with pytest.raises(BagError, match='no message of /scenario/reference'):
        compare_bags(bags, tmp_path / 'out', force=True)


def test_notes_say_what_the_numbers_depend_on(note):
    result = note('schema: 1')
    assert all(isinstance(value, str) for value in result.values())
    assert json.loads(result['parameters']) == PARAMETERS
    versions = json.loads(result['versions'])
    assert versions['numpy'] == np.__version__
    assert 'unknown' not in (versions['python'], versions['casadi'], versions['rclpy'])
    assert json.loads(result['machine'])['cores'] >= 1
    assert result['scenario_sha256'] == note('schema: 1')['scenario_sha256']
    assert result['scenario_sha256'] != note('schema: 2')['scenario_sha256']


def test_damage_is_no_warning_of_python_with_a_source_line(note, make_bag, tmp_path, recwarn):
    bag = make_bag('one', note('schema: 1'))
    (file,) = bag.glob('*.mcap')
    file.write_bytes(file.read_bytes()[:-9])
    with pytest.raises(BagError, match='no message of'):
        compare_bags([bag], tmp_path / 'out')
    assert not [item for item in recwarn if item.category is DamagedBagWarning]
