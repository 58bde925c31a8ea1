"""A car that spins, slides, leaves the road or stands still, in closed form, and its verdict."""

import io
import json

import numpy as np
import pytest
from evaluated_drives import compare_drives
from rich.console import Console

from bags import metrics_table
from bags.evaluation import geometry, metrics
from bags.evaluation.drive import Obstacle, Ticks
from bags.report.comparison import show_comparison
from experiments.run import node_graph, run_and_compare

LOST = ('lost', 'lost_how', 'lost_at_m')
ROAD = ('left_road', 'left_road_at_m', 'beyond_edge_m')


def moving(drive, direction, speed=20.0):
    """Return a drive whose velocity has an angle [rad], in the car's frame, that depends on x."""
    angle = direction(drive.motion.x)
    vx, vy = speed * np.cos(angle), speed * np.sin(angle)
    return drive._replace(motion=drive.motion._replace(vx=vx, vy=vy))


def standing(drive, from_m):
    """Return a drive that ends at a place of x [m], where the car stands."""
    motion = drive.motion
    there = motion.x >= from_m
    return drive._replace(
        motion=motion._replace(
            x=np.minimum(motion.x, from_m),
            vx=np.where(there, 0.0, motion.vx),
            vy=np.where(there, 0.0, motion.vy),
        )
    )


@pytest.fixture
def at(make_drive):
    """Return at(x, y): the straight road with one standing obstacle of 1 m radius."""

    def at(x, y):
        scene = make_drive().scene
        still = np.zeros(len(scene.obstacle_stamp_ns))
        item = Obstacle(1, still + x, still + y, still, still, 1.0)
        return scene._replace(obstacles=(item,))

    return at


def picked(found, names):
    return tuple(found[name] for name in names)


def test_a_car_on_its_way_is_neither_lost_nor_off_the_road(make_drive):
    result = metrics.compute_metrics(make_drive())
    assert picked(result, LOST) == (False, None, None)
    assert picked(result, ROAD) == (False, None, None)
    assert result['verdict'] == 'reached the finish line at 90 m; no collision'


def test_a_car_that_turns_round_has_spun_where_its_sideslip_became_large(make_drive):
    # 3 deg of sideslip per metre from 50 m on: 30 deg at 60 m, backwards from 80 m
    drive = moving(make_drive(), lambda x: np.radians(3.0 * np.maximum(x - 50.0, 0.0)))
    result = metrics.compute_metrics(drive)
    assert result['peak_sideslip_deg'] == pytest.approx(150.0)
    assert picked(result, LOST) == (True, 'spun', pytest.approx(60.0, abs=0.05))
    assert result['verdict'].startswith('reached the finish line at 90 m; spun at 60 m; ')


@pytest.mark.parametrize(('peak', 'how'), [(29.9, None), (30.1, 'sideslip'), (89.0, 'sideslip')])
@pytest.mark.parametrize('side', [-1, 1])
def test_a_slide_is_a_loss_of_control_above_30_deg(make_drive, peak, how, side):
    angle = side * np.radians(peak)
    result = metrics.compute_metrics(
        moving(make_drive(), lambda x: angle * np.sin(np.pi * x / 100.0))
    )
    assert (result['lost'], result['lost_how']) == (how is not None, how)
    if how:
        assert f'(sideslip angle up to {peak:.0f} deg)' in result['verdict']


def test_a_car_that_stands_has_no_sideslip(make_drive):
    drive = moving(make_drive(), lambda x: np.full(len(x), 3.0), speed=2.9)
    result = metrics.compute_metrics(drive)
    assert result['peak_sideslip_deg'] is None
    assert result['lost'] is False


def test_the_outline_leaves_the_road_before_its_centre_does(make_drive):
    # 1 m to the left every 10 m; the edge is 3 m away, half the width is 0.9 m
    result = metrics.compute_metrics(make_drive(y=lambda x: x / 10.0))
    assert result['left_road'] is True
    assert result['left_road_at_m'] == pytest.approx(21.0, abs=0.3)
    assert result['beyond_edge_m'] == pytest.approx(10.0 + 0.9 - 3.0, abs=0.03)
    assert 'left the road at 21 m, by up to 7.90 m' in result['verdict']


@pytest.mark.parametrize(('y', 'beyond'), [(2.09, None), (2.11, 0.01), (-2.09, None), (-4.0, 1.9)])
def test_either_edge_bounds_the_road(make_drive, y, beyond):
    result = metrics.compute_metrics(make_drive(y=y))
    assert result['left_road'] is (beyond is not None)
    assert result['beyond_edge_m'] == (beyond if beyond is None else pytest.approx(beyond))


def test_a_turned_car_leaves_the_road_with_its_nose(make_drive):
    result = metrics.compute_metrics(make_drive(y=1.0, yaw=np.pi / 2))
    assert result['beyond_edge_m'] == pytest.approx(1.0 + 2.4 - 3.0)


def test_the_inside_of_a_bend_is_left_with_the_middle_of_a_side(make_drive):
    # the inner edge bulges towards the car between its wheels
    scene = make_drive().scene
    bulge = np.array([[0.0, 3.0], [49.0, 3.0], [50.0, 1.5], [51.0, 3.0], [120.0, 3.0]])
    drive = make_drive(scene=scene._replace(left=bulge), y=0.8)
    assert metrics.compute_metrics(drive)['beyond_edge_m'] == pytest.approx(
        0.2 / np.hypot(1.0, 1.5), abs=0.02
    )


def test_before_its_beginning_an_edge_goes_on_straight(make_drive):
    # the edges begin 20 m ahead of the car, which is farther than its outline reaches
    scene = make_drive().scene
    late = np.array([[20.0, 0.0], [0.0, 0.0]])
    scene = scene._replace(left=scene.left + late, right=scene.right + late)
    result = metrics.compute_metrics(make_drive(scene=scene, y=lambda x: 2.5 * (x < 5.0)))
    assert result['left_road_at_m'] == 0.0
    assert result['beyond_edge_m'] == pytest.approx(2.5 + 0.9 - 3.0)


def test_who_passes_the_finish_line_beside_the_road_has_not_completed(make_drive):
    result = metrics.compute_metrics(make_drive(y=lambda x: x / 10.0))
    assert result['completed'] is False
    assert 'm; passed the finish line beside the road at 90 m; ' in result['verdict']


@pytest.mark.parametrize(('slope', 'code'), [(0.1, 1), (0.0, 0)])
def test_bags_run_says_why_it_fails_where_only_the_verdict_is_the_reason(
    make_drive, write_bag, tmp_path, monkeypatch, slope, code
):
    bag = write_bag(make_drive(y=lambda x: x * slope))
    # as the plant sees it: its finish line goes on beside the road
    outcome = node_graph.RunOutcome('mpcc', True, 'finish line crossed', bag)
    monkeypatch.setattr(
        run_and_compare, 'run_controllers', lambda plan, console: (tmp_path, [outcome])
    )
    console = Console(file=io.StringIO(), width=200)
    plan = run_and_compare.Request('straight', ['mpcc'], 'lockstep', tmp_path, [], 60.0)
    assert run_and_compare.run(plan, console) == code
    output = (
        'mpcc: not completed, although the plant reports "finish line crossed": '
        'left the road at 21 m, by up to 7.90 m; passed the finish line beside the road at 90 m'
    )
    assert (output in console.file.getvalue()) == (code == 1)


def test_a_car_that_stands_still_says_where_and_why(make_drive):
    drive = standing(make_drive(least_speed=7.0), 42.0)
    assert metrics.compute_metrics(drive)['verdict'].startswith('stood still at 42 m; ')
    braking = drive._replace(ticks=drive.ticks._replace(last_reason='too_slow'))
    output = (
        'stood still at 42 m (reason of the controller: too_slow: below 7 m/s it only brakes); '
    )
    assert metrics.compute_metrics(braking)['verdict'].startswith(output)


def test_what_led_to_the_end_comes_before_it_and_without_the_reason_it_makes_pointless(make_drive):
    spun = moving(
        make_drive(y=lambda x: x / 20.0, least_speed=7.0),
        lambda x: np.radians(3.0 * np.maximum(x - 40.0, 0.0)),
    )
    slow = standing(spun, 80.0)
    slow = slow._replace(ticks=slow.ticks._replace(last_reason='too_slow'))
    places = ('left the road at 42 m, by up to 2.90 m', 'spun at 50 m', 'stood still at 80 m')
    result = metrics.compute_metrics(slow)
    assert result['verdict'] == '; '.join((*places, 'no collision'))
    assert result['completed'] is False


def test_a_run_that_was_cut_says_where_and_how_fast(make_drive):
    result = metrics.compute_metrics(make_drive(metres=50.0))
    assert result['verdict'] == (
        'did not reach the finish line: ended at 50 m with 20.0 m/s; no collision'
    )


def test_a_run_without_commands_says_so(make_drive):
    drive = make_drive()
    silent = drive._replace(ticks=Ticks(np.empty(0, dtype=np.int64), *[np.empty(0)] * 3))
    assert metrics.compute_metrics(silent)['verdict'].endswith('; no command answered a state')


@pytest.mark.parametrize(
    ('offset', 'by', 'said'),
    [
        (2.2, None, 'no collision'),
        (2.0, 'circle', 'obstacle 1 (circle, overlap 0.10 m; outline passed by 0.10 m)'),
        (1.7, 'outline', 'obstacle 1 (outline, overlap 0.20 m)'),
    ],
)
def test_a_collision_says_whether_circle_or_outline_touched(make_drive, at, offset, by, said):
    result = metrics.compute_metrics(make_drive(scene=at(50.0, offset)))
    assert result['collided_by'] == by
    assert result['collided'] is (by is not None)
    assert said in result['verdict']


@pytest.fixture
def lost_runs(make_drive):
    """Return a sound run, one that left the road and one that spun on it."""
    spun = moving(make_drive(controller='spun'), lambda x: np.radians(2.0 * x))
    return {
        'sound': make_drive(controller='sound'),
        'off': make_drive(controller='off', y=lambda x: x / 10.0),
        'spun': spun,
    }


def test_nothing_is_green_beside_a_lost_car(lost_runs):
    result = {name: metrics.compute_metrics(item) for name, item in lost_runs.items()}
    for line in metrics_table.table_lines(result):
        sound, off, spun = (cell.good for cell in line.cells)
        assert True not in (off, spun), line.title
        if line.title in ('completed', 'collided', 'left the road', 'lost control'):
            assert sound is True, line.title
    cells = {line.title: line.cells for line in metrics_table.table_lines(result)}
    assert [cell.text for cell in cells['lost control']] == ['no', 'no', 'spun']
    assert [cell.text for cell in cells['left the road']] == ['no', 'yes', 'no']
    assert cells['lost control'][2].good is False
    assert cells['left the road'][1].good is False


def test_stations_of_losses_have_rows_only_where_there_was_one(make_drive, lost_runs):
    for drive, lost in ((make_drive(), False), (lost_runs['off'], True)):
        lines = metrics_table.table_lines({'one': metrics.compute_metrics(drive)})
        assert ('  outline beyond the edge' in [line.title for line in lines]) == lost


def test_three_lost_cars_fit_into_a_plain_terminal(make_drive):
    drive = moving(make_drive(y=lambda x: x / 10.0), lambda x: np.radians(0.5 * x))
    runs = dict.fromkeys(('mpcc', 'mpcc_no_ca', 'frenet'), metrics.compute_metrics(drive))
    console = Console(file=io.StringIO(), width=80)
    console.print(metrics_table.build_table({'scenario': 's', 'runs': runs}))
    assert 'sideslip  ' in console.file.getvalue()
    assert '…' not in console.file.getvalue()


def test_every_verdict_is_in_the_json_below_the_table_and_in_the_report(lost_runs, tmp_path):
    compared = compare_drives(lost_runs, tmp_path)
    console = Console(file=io.StringIO(), width=80)
    show_comparison(compared, console)
    page = ' '.join(compared.report.read_text().split())
    for name, result in json.loads(compared.file.read_text())['runs'].items():
        assert f'{name}: {result["verdict"]}\n' in console.file.getvalue()
        assert f'<strong>{name}</strong>: {result["verdict"]}</li>' in page


def test_points_of_an_outline_begin_and_end_at_its_corners():
    points = geometry.outline_points(geometry.Outline(2.0, 3.0, 1.8), 0.6)
    assert np.abs(points[:, 1]).tolist() == [0.9] * len(points)
    assert (points[:, 0].min(), points[:, 0].max()) == (-3.0, 2.0)
    assert np.diff(np.unique(points[:, 0])).max() <= 0.6
    (turned,) = geometry.transform_to_map(points[:1], *np.array([[5.0], [7.0], [np.pi / 2]]))
    assert turned[0] == pytest.approx([5.0 - 0.9, 7.0 - 3.0])
