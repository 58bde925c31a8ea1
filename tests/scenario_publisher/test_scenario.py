import numpy as np
import pytest

from scenario_publisher import scenario
from scenario_publisher.scenario import START_NS, ScenarioError


def test_name_and_path_lead_to_the_same_scenario(tmp_path):
    named = scenario.load('straight')
    path = tmp_path / 'other.yaml'
    path.write_text(named.text)
    for given in (path, str(path)):
        assert scenario.load(given).text == named.text
        assert scenario.load(given).name == 'straight'


def test_relative_file_ending_in_yaml_is_a_path(tmp_path, monkeypatch, text):
    (tmp_path / 'straight.yaml').write_text(text)
    monkeypatch.chdir(tmp_path)
    assert scenario.load('straight.yaml').name == 'bend'
    assert scenario.load('./straight.yaml').name == 'bend'
    assert scenario.load('straight').name == 'straight'


@pytest.mark.parametrize(
    ('wanted', 'is_listed'),
    [
        ('double_lane_chang', True),
        ('here/double_lane_chang.yaml', False),
        ('~nosuchuser/double_lane_chang.yaml', False),
        ('', True),
    ],
)
def test_unknown_scenario_is_answered_with_those_that_exist(wanted, is_listed):
    with pytest.raises(ScenarioError) as caught:
        scenario.load(wanted)
    assert repr(wanted) in str(caught.value)
    for name in scenario.available():
        assert not is_listed or name in str(caught.value)
    assert ("did you mean 'double_lane_change'" in str(caught.value)) == bool(wanted)


def test_a_file_is_named_where_its_name_or_its_neighbours_is_given(tmp_path, monkeypatch, text):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'tractor_bend.yaml').write_text(text)
    with pytest.raises(ScenarioError, match=r'give its path, \./tractor_bend\.yaml$'):
        scenario.load('tractor_bend')
    near = r"^no file './tractr_bend\.yaml': this folder holds tractor_bend\.yaml; did you mean "
    with pytest.raises(ScenarioError, match=near):
        scenario.load('./tractr_bend.yaml')
    with pytest.raises(ScenarioError, match=r"'there/a\.yaml': there is no folder there$"):
        scenario.load('there/a.yaml')
    (tmp_path / 'there').mkdir()
    with pytest.raises(ScenarioError, match=r"'there/a\.yaml': there is no YAML file in there$"):
        scenario.load('there/a.yaml')


def test_constant_speed_stands_between_all_poses(make, tree):
    ref = make(tree).reference
    assert ref.t[0] == 0.0
    assert np.diff(ref.t) == pytest.approx(np.full(len(ref.t) - 1, 0.5 / 10.0), rel=1e-9)


def test_speed_table_stands_between_the_poses_of_its_stations(make, tree):
    tree['speed'] = {'stations_m': [0.0, 20.0, 40.0], 'speeds_mps': [10.0, 10.0, 20.0]}
    ref = make(tree).reference
    speed = 0.5 / np.diff(ref.t)
    middle = 0.25 + 0.5 * np.arange(len(speed))
    assert speed == pytest.approx(np.interp(middle, [0, 20, 40], [10, 10, 20]), rel=1e-3)


def test_start_on_the_path_has_its_pose_and_desired_speed(make, tree):
    tree['start'] = {'progress_m': 55.0}
    tree['stop']['progress_m'] = 70.0
    start = make(tree).start
    exact = (40 + 50 * np.sin(0.3), 50 - 50 * np.cos(0.3), 0.3, 10.0, 0.0, 0.0)
    assert start == pytest.approx(exact, abs=1e-5)


def test_start_with_a_pose_is_taken_as_given_with_its_heading_wrapped(make, tree):
    tree['start'] = {'x_m': 3.0, 'y_m': -1.0, 'yaw_rad': 6.2, 'speed_mps': 7.5}
    assert make(tree).start == pytest.approx((3.0, -1.0, 6.2 - 2 * np.pi, 7.5, 0.0, 0.0))


@pytest.mark.parametrize('place', [{'progress_m': 0.0}, {'x_m': 0.0, 'y_m': 0.0, 'yaw_rad': 0.0}])
def test_a_start_may_slide_turn_and_stand(make, tree, place):
    tree['start'] = place | {'speed_mps': 0.0, 'lateral_mps': -8.0, 'yaw_rate_radps': 0.9}
    assert make(tree).start[3:] == (0.0, -8.0, 0.9)


def test_given_start_speed_beats_the_desired_one(make, tree):
    tree['start'] = {'progress_m': 0.0, 'speed_mps': 4.0}
    assert make(tree).start.speed == 4.0


def test_finish_line_lies_on_the_path_and_counts_from_half_way(make, tree):
    stop = make(tree).stop
    exact = (40 + 50 * np.sin(0.4), 50 - 50 * np.cos(0.4), 0.4, 30.0, 20.0)
    assert stop[:5] == pytest.approx(exact, abs=1e-4)


def test_finish_line_counts_from_half_way_of_what_is_left_to_travel(make, tree):
    tree['start'] = {'progress_m': 30.0}
    assert make(tree).stop.armed_after == pytest.approx(15.0, abs=0.5)


def test_second_crossing_of_the_finish_line_is_the_one_that_counts():
    circle = scenario.load('circle_20m')
    lap = 2 * np.pi * 20.0
    # one lap before the finish, and half a lap before it in the other direction
    assert 132.0 - lap / 2 < circle.stop.armed_after < 132.0
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


def test_obstacle_on_the_road_lies_where_the_road_is(make, tree):
    obstacle = make(tree).actors[1].obstacle
    exact = (40 + 52 * np.sin(0.4), 50 - 52 * np.cos(0.4))
    assert pytest.approx(exact, abs=1e-4) == (obstacle.X, obstacle.Y)


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


def test_same_file_gives_the_same_bytes():
    first, second = scenario.load('double_lane_change'), scenario.load('double_lane_change')
    for a, b in zip((*first.reference, *first.edges), (*second.reference, *second.edges)):
        assert np.array_equal(a, b)


def test_every_speed_is_known_by_its_key(make, tree):
    tree['speed'] = {'stations_m': [0.0, 40.0], 'speeds_mps': [10.0, 6.0]}
    tree['start'] = {'progress_m': 0.0}
    desired = (('speed.speeds_mps[0]', 10.0), ('speed.speeds_mps[1]', 6.0))
    assert make(tree).speeds == desired
    tree['start'] = {'progress_m': 0.0, 'speed_mps': 5.0}
    assert make(tree).speeds == (('start.speed_mps', 5.0), *desired)
    tree['speed'] = {'constant_mps': 4.0}
    assert make(tree).speeds == (('start.speed_mps', 5.0), ('speed.constant_mps', 4.0))
