"""`experiments library`: draws and entries are driven once, judged, listed, written, documented."""

import re
from pathlib import Path

import pytest
from pyarrow import parquet

from bags.evaluation import metrics
from bags.evaluation.metrics import survival
from experiments import cli, code_version, pass_criteria, simulation
from experiments import library as emergencies
from experiments.commands import library
from experiments.families import draw, feasibility
from scenario_publisher import scenario
from scenario_publisher.expectations import Expectation, Expectations

DOCS = Path(__file__).parents[2] / 'docs'
QUICK = ('pop_up_late', 'oncoming_car')
ENTRIES = emergencies.entries_of_library()


@pytest.mark.usefixtures('tasks_here')
def test_draws_are_driven_once_and_judged(tmp_path, capsys):
    def drive(draws, *more):
        command = ['library', '--family', 'crossing_pedestrian', '--draws', str(draws), '--seed']
        command += ['1', '--controller', 'mpcc', '--out', str(tmp_path), '--jobs', '1']
        assert cli.main([*command, *more]) == 0
        return capsys.readouterr().out, parquet.read_table(tmp_path / 'results.parquet').to_pylist()

    said, rows = drive(1)
    (row,) = rows
    assert (row['scenario'], row['draw']) == ('crossing_pedestrian:0', 0)
    assert row['survived'] is (row['lost_by'] is None)
    assert row['code_version'] == code_version.digest()
    assert '1 drives: 0 were kept, 0 failed' in said
    # other parameters: driven anew, and the table says with which
    said, (changed,) = drive(1, '--set', 'controller.safety.obstacle_m=0.6')
    assert '1 drives: 0 were kept, 0 failed' in said
    assert 'controller.safety.obstacle_m' not in row
    assert changed['controller.safety.obstacle_m'] == 0.6
    # more draws: the first ones are kept; no family can survive more than all of its draws
    said, more = drive(2, '--at-least', '0')
    assert '2 drives: 1 were kept, 0 failed' in said
    assert more[0] == row
    assert more[1]['scenario'] == 'crossing_pedestrian:1'


def test_the_list_has_every_family_and_entry(capsys):
    assert cli.main(['library', '--list']) == 0
    output = capsys.readouterr().out
    for name in (*draw.LIBRARY, *ENTRIES):
        assert f'\n{name} ' in output


@pytest.mark.parametrize('difficulty', draw.DIFFICULTIES)
def test_a_draw_is_written_as_a_scenario_file(tmp_path, difficulty):
    path = tmp_path / 'one.yaml'
    command = ['library', '--draw', 'slalom:3', '--seed', '7', '--difficulty', difficulty]
    assert cli.main([*command, '--out', str(path)]) == 0
    one = draw.draw('slalom', 7, 3, difficulty)
    written = scenario.load(path)
    assert written.text.endswith(one.text)
    for role, values in one.settings.items():
        for name, value in values.items():
            assert f'--set {role}.{name}={value}' in written.text.splitlines()[0]


@pytest.mark.parametrize(
    'name',
    [
        *QUICK,
        *(pytest.param(name, marks=pytest.mark.slow) for name in ENTRIES if name not in QUICK),
    ],
)
def test_an_entry_comes_to_what_its_file_expects_driven_by_mpcc_road(name):
    setup = simulation.prepare(name, 'mpcc_road')
    values = metrics.compute_metrics(simulation.drive(setup))
    outcomes = pass_criteria.judge(setup.scn.expect, values)
    assert outcomes
    assert {o.expectation.metric: o.measured for o in outcomes if not o.is_met} == {}


def row(family='pop_up', controller='mpcc', survived=True, error=''):
    base = {'scenario': f'{family}:0', 'family': family, 'controller': controller, 'error': error}
    lost_by = None if survived else 'slid'
    return {**base, 'survived': survived, 'lost_by': lost_by, 'verdict': 'spun at 60 m'}


def test_drives_are_counted_by_family_and_controller_and_failed_ones_left_out():
    rows = [row(), row(survived=False), row(error='crashed'), row(family='slalom')]
    rows += [row(controller='frenet')]
    counts = emergencies.counts(rows)
    assert counts['pop_up', 'mpcc'] == (1, 2)
    assert counts[emergencies.ALL, 'mpcc'] == (2, 3)
    # whoever cannot be judged has not survived
    assert emergencies.counts([row(survived=None)]) == {('pop_up', 'mpcc'): (0, 1)}
    assert list(emergencies.describe_losses([*rows[:2], row(survived=None, error='slow')])) == [
        'pop_up:0 mpcc: slid (spun at 60 m)',
        'pop_up:0 mpcc: no result: slow',
    ]
    assert emergencies.families_below(rows, 0.5) == []
    assert emergencies.families_below(rows, 0.51) == ['mpcc in pop_up: 1/2']
    # as floats 0.55 times 100 is more than 55
    assert emergencies.families_below([row()] * 55 + [row(survived=False)] * 45, 0.55) == []


def test_the_documentation_has_every_family_entry_and_number():
    text = (DOCS / 'library.md').read_text()
    rows = re.findall(r'^\| ((?:`\w+`(?:, )?)+) \|', text, re.M)
    assert set(re.findall(r'`(\w+)`', ' '.join(rows))) == set(draw.LIBRARY)
    assert {path.stem for path in (DOCS / 'scenarios').iterdir()} == set(ENTRIES)
    low, high = draw.HARD_FRICTION
    for words in (
        f'a friction of {low:g} to {high:g} that it believes to be {draw.BELIEVED_FRICTION:g}',
        f'up to {draw.HARD_DELAY_MS[1]} ms late',
        f'up to {draw.HARD_BIASES["left_bias_m"]:g} m to the side',
        f'{draw.HARD_BIASES["ahead_bias_m"]:g} m ahead',
        f'{100 * draw.HARD_BIASES["speed_error"]:g} % of error of the speed',
        f'missed for {100 * draw.HARD_NOISE["obstacle_dropout"]:g} %',
        f'with {feasibility.GRIP_SHARE:g} of the friction, {feasibility.DELAY_S:g} s late',
        f'and {feasibility.CLEARANCE:g} m',
        f'further than {survival.SHOULDER_M:g} m off the road',
        f'above {survival.SLIDING_FROM_MPS:g} m/s',
        f'from {library.DRAWN["seed"]} on**, which is the default',
    ):
        assert words in ' '.join(text.split())


def test_sizes_of_the_car_in_the_closed_forms_are_those_of_the_plant():
    car = simulation.prepare('straight', 'mpcc').plant.car
    nose = car.body.cog_to_front_m + car.outline.front_overhang_m
    # rounded up: a draw that is possible for a larger car is for this one
    assert 0.0 <= feasibility.CAR_WIDTH - car.outline.width_m < 0.02
    assert 0.0 <= feasibility.CAR_NOSE - nose < 0.2


METRICS = {
    'survived': True,
    'min_v2o_per_obstacle_m': {'1': 0.4, '2': None},
    'peak_sideslip_deg': 12.0,
}


@pytest.mark.parametrize(
    ('expectation', 'measured', 'is_met'),
    [
        (Expectation('survived', value=True), True, True),
        (Expectation('min_v2o_per_obstacle_m.1', at_least=0.5), 0.4, False),
        (Expectation('min_v2o_per_obstacle_m.2', at_least=0.5), None, False),
        (Expectation('min_v2o_per_obstacle_m.3', at_least=0.5), None, False),
        (Expectation('peak_sideslip_deg', at_most=12.0), 12.0, True),
    ],
)
def test_measured_values_are_found_by_their_dotted_names(expectation, measured, is_met):
    (outcome,) = pass_criteria.judge(Expectations([expectation]), METRICS)
    assert (outcome.measured, outcome.is_met) == (measured, is_met)
