"""Drives from Python: real ones, of a few seconds of simulated time each."""

import subprocess
import sys

import numpy as np
import pytest
import yaml

import experiments
from bags.errors import BagError
from bags.evaluation import metrics
from experiments import compare, drive, drive_many, scripting, simulation
from mpcc_controller.driving import prediction_model
from scenario_publisher import scenario

ROAD = yaml.safe_load(scenario.load('straight').text)
ROAD['name'] = 'short'
ROAD['stop'] = {'progress_m': 12.0, 'time_s': 5.0}
TOLERANCE = 'controller.tolerances.contouring_m'
SPEED = 'scenario.speed_mps'
SCRIPT = """
import yaml
from experiments import drive_many
with open({file!r}) as file:
    road = yaml.safe_load(file)
runs = drive_many(road, settings={{'scenario.speed_mps': [14, 16]}}, jobs=2)
print('min speeds', *(round(run.metrics['min_speed_mps']) for run in runs))
"""


@pytest.fixture(scope='module')
def run():
    return drive(ROAD, settings={TOLERANCE: 0.4})


def numbers(values):
    """Return the metrics that are no computing times."""
    return {name: value for name, value in values.items() if not name.startswith('solve_')}


def test_a_drive_has_the_metrics_topics_and_signals_of_the_simulation(run):
    setup = simulation.prepare_scenario(
        scenario.parse(yaml.safe_dump(ROAD), 'road'), 'mpcc', {'controller': {TOLERANCE[11:]: 0.4}}
    )
    assert numbers(run.metrics) == numbers(metrics.compute_metrics(simulation.drive(setup)))
    assert run.metrics['completed']
    assert run.parameters[TOLERANCE] == 0.4
    assert (run.settings, run.label) == ({TOLERANCE: 0.4}, 'mpcc, contouring_m=0.4')
    assert len(run.topics) == 11
    assert len(run.frame('/controller/prediction').loc[0.0]) == 51
    commanded, actual = run.signals['steer_command_rad'], run.signals['steer_rad']
    assert (commanded - actual).abs().max() < 0.01
    assert run.signals['tyre_use.fl'].max() < 0.2
    assert run.signals['model_friction_use.front'].notna().all()


def test_scenarios_are_names_files_objects_or_their_content_and_give_the_same_runs(run, tmp_path):
    file = tmp_path / 'road.yaml'
    file.write_text(yaml.safe_dump(ROAD))
    given = [file, scenario.load(str(file)), ROAD]
    runs = drive_many(given, settings=[{TOLERANCE: np.float64(0.4)}])
    assert all(numbers(other.metrics) == numbers(run.metrics) for other in runs)
    again = [*runs][-1]
    assert again.frame('/vehicle/odometry').equals(run.frame('/vehicle/odometry'))


def test_speed_friction_and_car_may_be_others(run):
    slow = drive(ROAD, settings={SPEED: 10, 'scenario.friction': 0.5})
    assert slow.metrics['min_speed_mps'] == pytest.approx(10.0, abs=0.5)
    assert slow.parameters['plant.friction'] == 0.5
    assert slow.parameters['controller.model.friction'] == 0.5
    with pytest.raises(BagError, match=r'does not fit the plant: mass .*any_car=True'):
        drive(ROAD, plant='bmw_320i')
    other = drive(ROAD, plant='bmw_320i', any_car=True, label='smaller')
    masses = [one.parameters['plant.car.body.mass_kg'] for one in (run, other)]
    assert masses[0] != masses[1]
    both = compare(run, other).frame()
    assert both.loc['smaller', 'plant.plant_params'] == 'bmw_320i.yaml'


def test_a_grid_of_settings():
    runs = drive_many(ROAD, ['mpcc', 'frenet'], {SPEED: [14.0, 16.0], TOLERANCE: [0.5]})
    assert runs.labels == [f'{c}, speed_mps={v}' for c in ('mpcc', 'frenet') for v in (14, 16)]
    frame = runs.frame()
    assert frame['min_speed_mps'].to_numpy() == pytest.approx(frame[SPEED].to_numpy(), abs=0.3)
    assert list(frame['controller']) == ['mpcc', 'mpcc', 'frenet', 'frenet']


def test_a_problem_is_checked_once_for_all_drives_that_solve_it(monkeypatch):
    checked = []
    with monkeypatch.context() as patched:
        patched.setattr(scripting.inputs, 'check_problem', lambda nodes, _: checked.append(nodes))
        patched.setattr(scripting, '_simulate_all', lambda setups, jobs: setups[:0])
        drive_many(ROAD, 'mpcc', {SPEED: [14.0, 15.0, 16.0], TOLERANCE: [0.4, 0.5]})
    assert [nodes['controller'][0].tolerances.contouring_m for nodes in checked] == [0.4, 0.5]
    # nor does a drive check its problem again
    checked, check = [], prediction_model.problem_check.check
    monkeypatch.setattr(
        prediction_model.problem_check,
        'check',
        lambda formulation, params: (checked.append(params), check(formulation, params)),
    )
    tolerances = [0.401, 0.402]
    drive_many(ROAD, 'mpcc', {TOLERANCE: tolerances}, jobs=1)
    assert [params.tolerances.contouring_m for params in checked] == pytest.approx(tolerances)


def test_processes_give_the_same_runs_and_need_no_main_guard(tmp_path):
    """A script as a newcomer writes it: its processes do not run it again."""
    (tmp_path / 'road.yaml').write_text(yaml.safe_dump(ROAD))
    script = tmp_path / 'sweep.py'
    script.write_text(SCRIPT.format(file=str(tmp_path / 'road.yaml')))
    done = subprocess.run([sys.executable, script], capture_output=True, text=True)
    assert done.stdout == 'min speeds 14 16\n', done.stderr


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        ({'scenario': 'no/such.yaml'}, 'no/such.yaml'),
        ({'scenario': {'schema': 1}}, 'the given scenario'),
        ({'scenario': 3}, 'scenario: is 3; allowed a name'),
        ({'plant': 'vw_gtx'}, 'no file config/vw_gtx; it has bmw_320i'),
        ({'settings': ['x']}, 'must be a mapping'),
        ({'settings': {'tolerances.contouring_m': 1.0}}, f"did you mean '{TOLERANCE}'"),
        ({'settings': {TOLERANCE: -1.0}}, f"settings['{TOLERANCE}']: tolerances.contouring_m: is "),
        ({'settings': {'scenario.speed': 20.0}}, f"did you mean '{SPEED}'"),
        ({'settings': {SPEED: 'fast'}}, "settings['scenario.speed_mps']: must be a number"),
        ({'settings': {'plant.mode': 'realtime'}}, 'has no effect in process'),
        ({'settings': {'recorder.out': '/tmp'}}, "unknown name 'recorder.out'"),
        ({'sensors': 'nautical'}, 'sensors_automotive.yaml'),
        ({'settings': {'estimator.method': 'raw'}}, 'has no effect without plant.sensors'),
        ({'settings': {'estimator.method': 'best'}, 'sensors': 'survey'}, 'allowed filter or kin'),
    ],
)
def test_a_mistake_is_named_with_what_is_allowed(given, message):
    with pytest.raises(BagError) as caught:
        drive(**{'scenario': ROAD, **given})
    assert message in str(caught.value)
    assert '--set' not in str(caught.value)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        ({'controller': []}, 'controller: is an empty list'),
        ({'settings': {SPEED: []}}, 'settings: scenario.speed_mps: is an empty list'),
        ({'settings': [{SPEED: 15}, {SPEED: -1}]}, "['scenario.speed_mps']: is -1"),
        ({'jobs': 0}, 'jobs: is 0; allowed a whole number from 1'),
    ],
)
def test_inputs_of_a_sweep_are_checked_before_the_first_drive(options, message, monkeypatch):
    monkeypatch.setattr(simulation, 'run', lambda setup: pytest.fail('drives'))
    with pytest.raises(BagError) as caught:
        drive_many(ROAD, **options)
    assert message in str(caught.value)


def test_runs_of_two_scenarios_have_no_common_figure():
    runs = drive_many([ROAD, {**ROAD, 'name': 'other'}])
    assert runs.labels == ['mpcc in short', 'mpcc in other']
    with pytest.raises(BagError, match='the runs drove'):
        runs.figure()


def test_names_of_the_package():
    assert {'drive', 'drive_many', 'compare'} <= set(dir(experiments))
    with pytest.raises(AttributeError, match='no attribute'):
        experiments.drives  # noqa: B018


@pytest.fixture(scope='module')
def felt():
    """Return the drive of a car with sensors."""
    return drive(ROAD, settings={TOLERANCE: 0.4}, sensors='automotive')


def test_sensors_of_a_car_are_recorded_and_repeatable(run, felt):
    named = {TOLERANCE: 0.4, 'plant.sensors': 'sensors_automotive.yaml'}
    again, other = (drive(ROAD, settings=named | more) for more in ({}, {'plant.sensors_seed': 5}))
    for topic in ('/sensors/inertial', '/sensors/chassis', '/sensors/gnss'):
        assert felt.frame(topic).equals(again.frame(topic))
        assert not felt.frame(topic).equals(other.frame(topic))
        assert topic not in run.topics


def test_the_controller_of_a_car_with_sensors_is_fed_what_the_estimator_believes(run, felt):
    settings = {TOLERANCE: 0.4, 'estimator.method': 'raw'}
    raw = drive(ROAD, settings=settings, sensors='automotive')
    believed = felt.frame('/estimator/odometry')
    actual = felt.frame('/vehicle/odometry').loc[believed.index]
    assert 0 < (believed.vx_mps - actual.vx_mps).abs().max() < 0.2
    commands = [one.frame('/controller/command').steer_rad for one in (run, felt, raw)]
    assert not commands[0].equals(commands[1])
    assert not commands[1].equals(commands[2])
