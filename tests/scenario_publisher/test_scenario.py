import numpy as np
import pytest

from scenario_publisher import scenario
from scenario_publisher.expectations import Expectation
from scenario_publisher.scenario import START_NS, ScenarioError


def test_a_name_is_a_shipped_scenario_and_a_path_a_file(tmp_path, monkeypatch, text):
    (tmp_path / 'straight.yaml').write_text(text)
    monkeypatch.chdir(tmp_path)
    assert scenario.load('straight').name == 'straight'
    for path in ('straight.yaml', './straight.yaml', tmp_path / 'straight.yaml'):
        assert scenario.load(path).name == 'bend'
        assert scenario.load(path).text == text


NAMES = ', '.join(scenario.available())
LONG = 300 * 'a'  # no file system has files of such a name
MEANT = "; did you mean 'double_lane_change'?"


@pytest.mark.parametrize(
    ('wanted', 'error'),
    [
        (
            'double_lane_chang',
            f"no scenario 'double_lane_chang'; available: {NAMES}, or a file{MEANT}",
        ),
        ('', f"no scenario ''; available: {NAMES}, or a file"),
        (LONG, f"no scenario '{LONG}'; available: {NAMES}, or a file"),
        (f'{LONG}/{LONG}.yaml', f"no file '{LONG}/{LONG}.yaml': there is no folder {LONG}"),
        (
            'no/double_lane_chang.yaml',
            f"no file 'no/double_lane_chang.yaml': there is no folder no{MEANT} (without path and "
            '.yaml)',
        ),
        (
            '~nosuchuser/double_lane_chang.yaml',
            "no file '~nosuchuser/double_lane_chang.yaml': there is no folder ~nosuchuser"
            f'{MEANT} (without path and .yaml)',
        ),
        (
            'tractor_bend',
            "no scenario 'tractor_bend' comes with the package; there is a file tractor_bend.yaml "
            'in this folder: give its path, ./tractor_bend.yaml',
        ),
        (
            './tractr_bend.yaml',
            "no file './tractr_bend.yaml': this folder holds tractor_bend.yaml; did you mean "
            "'tractor_bend.yaml'?",
        ),
        ('there/a.yaml', "no file 'there/a.yaml': there is no YAML file in there"),
    ],
)
def test_what_is_no_scenario_is_answered_with_what_there_is(
    tmp_path, monkeypatch, text, wanted, error
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'tractor_bend.yaml').write_text(text)
    (tmp_path / 'there').mkdir()
    with pytest.raises(ScenarioError) as caught:
        scenario.load(wanted)
    assert str(caught.value) == error


def test_a_file_with_the_name_of_a_shipped_scenario_is_told(tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    assert scenario.describe_namesake('straight', scenario.load('straight')) == ''
    mine = tmp_path / 'straight.yaml'
    mine.write_text(text.replace('name: bend', 'name: straight'))
    told = scenario.describe_namesake('./straight.yaml', scenario.load('./straight.yaml'))
    assert told.startswith('./straight.yaml has the name of a scenario that comes with the package')
    told = scenario.describe_namesake('straight', scenario.load('straight'))
    assert told.endswith(
        'not the file straight.yaml in this folder: for that one give ./straight.yaml'
    )
    mine.write_text(scenario.load('straight').text)
    for given in ('straight', './straight.yaml'):
        assert scenario.describe_namesake(given, scenario.load(given)) == ''


def test_the_desired_speed_stands_between_the_poses(make, tree):
    ref = make(tree).reference
    assert ref.t[0] == 0.0
    assert np.diff(ref.t) == pytest.approx(np.full(len(ref.t) - 1, 0.5 / 10.0), rel=1e-9)
    tree['speed'] = {'stations_m': [0.0, 20.0, 40.0], 'speeds_mps': [10.0, 10.0, 20.0]}
    speed = 0.5 / np.diff(make(tree).reference.t)
    middle = 0.25 + 0.5 * np.arange(len(speed))
    assert speed == pytest.approx(np.interp(middle, [0, 20, 40], [10, 10, 20]), rel=1e-3)


BEND_55 = (40 + 50 * np.sin(0.3), 50 - 50 * np.cos(0.3), 0.3)  # pose at 55 m
POSE = {'x_m': 3.0, 'y_m': -1.0, 'yaw_rad': 6.2}
SLIDES = {'speed_mps': 0.0, 'lateral_mps': -8.0, 'yaw_rate_radps': 0.9}


@pytest.mark.parametrize(
    ('start', 'expected'),
    [
        ({'progress_m': 55.0}, (*BEND_55, 10.0, 0.0, 0.0)),
        ({'progress_m': 55.0, 'speed_mps': 4.0}, (*BEND_55, 4.0, 0.0, 0.0)),
        ({'progress_m': 55.0} | SLIDES, (*BEND_55, 0.0, -8.0, 0.9)),
        (POSE | {'speed_mps': 7.5}, (3.0, -1.0, 6.2 - 2 * np.pi, 7.5, 0.0, 0.0)),
        (POSE | SLIDES, (3.0, -1.0, 6.2 - 2 * np.pi, 0.0, -8.0, 0.9)),
    ],
)
def test_a_start_is_on_the_path_at_its_desired_speed_or_as_given(make, tree, start, expected):
    tree['start'], tree['stop']['progress_m'] = start, 70.0
    assert make(tree).start == pytest.approx(expected, abs=1e-5)


def test_finish_line_lies_on_the_path_and_counts_from_half_way(make, tree):
    stop = make(tree).stop
    exact = (40 + 50 * np.sin(0.4), 50 - 50 * np.cos(0.4), 0.4, 30.0, 20.0)
    assert stop[:5] == pytest.approx(exact, abs=1e-4)
    tree['start'] = {'progress_m': 30.0}  # of what is left to travel
    assert make(tree).stop.armed_after == pytest.approx(15.0, abs=0.5)


def test_second_crossing_of_the_finish_line_is_the_one_that_counts():
    circle = scenario.load('circle_20m')
    lap = 2 * np.pi * 20.0
    # crossed half a lap before, in the other direction: from half way between on
    assert circle.stop.armed_after == pytest.approx(132.0 - lap / 4, abs=0.3)
    assert -np.pi <= circle.stop.psi <= np.pi


def test_obstacles_at_the_start_carry_the_stamp_of_the_start(make, tree):
    scn = make(tree)
    assert scn.obstacles.stamp_ns == scn.reference.stamp_ns == scn.edges.stamp_ns == START_NS
    assert [o.id for o in scn.obstacles.items] == [1, 2]
    assert scenario.obstacles_at(scn, 0.0, START_NS) == scn.obstacles


def test_obstacles_come_go_and_move_but_keep_their_ids(make, tree):
    tree['obstacles'][0] |= {'vx_mps': 2.0, 'disappears_at_s': 3.0}
    tree['obstacles'][1] |= {'appears_at_s': 1.0}
    scn = make(tree)
    seen = {t: [o.id for o in scenario.obstacles_at(scn, t, 7).items] for t in (-1, 0, 1, 2, 3)}
    assert seen == {-1: [1], 0: [1], 1: [1, 2], 2: [1, 2], 3: [2]}
    assert pytest.approx(25.0) == scenario.obstacles_at(scn, 2.5, 7).items[0].X
    assert scenario.obstacles_at(scn, 2.5, 7).stamp_ns == 7


def mirror(tree):
    """Turn everything to the other side of the x axis."""
    for block in (tree['road']['centre_line'], tree['path']):
        block['segments'][1]['arc']['curvature_1pm'] *= -1
    edges = tree['road']['edges']
    left, right = edges['left']['offset_m'], edges['right']['offset_m']
    edges['left']['offset_m'], edges['right']['offset_m'] = -right, -left
    tree['obstacles'][0]['y_m'] *= -1
    tree['obstacles'][1]['offset_m'] *= -1
    return tree


def test_mirrored_scenario_mirrors_everything(make, tree):
    tree['road']['edges']['left']['offset_m'] = 6.0
    first, second = make(tree), make(mirror(tree))
    flip = np.array([1.0, -1.0])
    assert pytest.approx(-first.reference.Y, abs=1e-12) == second.reference.Y
    assert second.reference.psi == pytest.approx(-first.reference.psi, abs=1e-12)
    assert second.edges.left == pytest.approx(first.edges.right * flip, abs=1e-12)
    assert second.edges.right == pytest.approx(first.edges.left * flip, abs=1e-12)
    for a, b in zip(first.actors, second.actors):
        assert pytest.approx((a.obstacle.X, -a.obstacle.Y)) == (b.obstacle.X, b.obstacle.Y)


def test_published_lines_are_sampled_as_asked(make, tree):
    tree['sampling'] = {'path_m': 0.25, 'edges_m': 2.0}
    scn = make(tree)
    steps = np.hypot(np.diff(scn.reference.X), np.diff(scn.reference.Y))
    assert steps.max() == pytest.approx(0.25, rel=1e-4)
    # outside of the bend an edge is longer than the centre line
    assert 1.9 < np.hypot(*np.diff(scn.edges.right, axis=0).T).max() < 2.2


def test_every_speed_is_known_by_its_key(make, tree):
    tree['speed'] = {'stations_m': [0.0, 40.0], 'speeds_mps': [10.0, 6.0]}
    tree['start'] = {'progress_m': 0.0}
    desired = (('speed.speeds_mps[0]', 10.0), ('speed.speeds_mps[1]', 6.0))
    assert make(tree).speeds == desired
    tree['start'] = {'progress_m': 0.0, 'speed_mps': 5.0}
    assert make(tree).speeds == (('start.speed_mps', 5.0), *desired)
    tree['speed'] = {'constant_mps': 4.0}
    assert make(tree).speeds == (('start.speed_mps', 5.0), ('speed.constant_mps', 4.0))


EXPECT = """
expect:
  survived: true
  min_v2o_per_obstacle_m.1: {at_least: 0.2}
  peak_sideslip_deg: {at_least: 1, at_most: 15.0}
"""


def test_expectations_are_read_in_their_order(make, text):
    assert make(text + EXPECT).expect == (
        Expectation('survived', value=True),
        Expectation('min_v2o_per_obstacle_m.1', at_least=0.2),
        Expectation('peak_sideslip_deg', at_least=1.0, at_most=15.0),
    )
    assert make(text).expect == ()


@pytest.mark.parametrize(
    ('expectation', 'measured', 'met'),
    [
        (Expectation('a', value=True), True, True),
        (Expectation('a', value=False), True, False),
        (Expectation('a', value=True), None, False),
        # a number is no yes
        (Expectation('a', value=True), 1, False),
        (Expectation('a', at_least=0.2), 0.2, True),
        (Expectation('a', at_least=0.2), 0.19, False),
        (Expectation('a', at_most=2.0), 2.1, False),
        (Expectation('a', at_least=0.0, at_most=2.0), 1, True),
        # no obstacle has no gap: what is missing meets no bound
        (Expectation('a', at_least=0.0), None, False),
        (Expectation('a', at_least=0.0), 'slid', False),
    ],
)
def test_what_meets_an_expectation(expectation, measured, met):
    assert expectation.is_met_by(measured) is met
