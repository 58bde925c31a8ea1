"""Bags in, one JSON file, a table and figures out."""

import io
import json

import numpy as np
import pytest
from evaluated_drives import compare_drives, evaluate_runs
from rich.console import Console

from bags import cli, metrics_table
from bags.errors import BagError
from bags.evaluation import metrics
from bags.evaluation.drive import Obstacle
from bags.evaluation.metrics.registry import METRICS
from bags.figures import comparison_figures, panels, style
from bags.report import comparison as comparison_module
from bags.report.comparison import show_comparison
from scenario_publisher.scenario import load as load_scenario

DAMAGE = {'mpcc': 'mpcc_0.mcap: damaged at byte 7 (cut); read up to there'}


@pytest.fixture(scope='module')
def drives(drives, make_drive):
    """Return three drives past two obstacles, one of which moves."""
    third = make_drive(scene=drives['mpcc'].scene, controller='mpcc_no_ca')
    return {'mpcc': drives['mpcc'], 'mpcc_no_ca': third, 'own': drives['own']}


@pytest.fixture(scope='module')
def comparison(drives, tmp_path_factory):
    return compare_drives(drives, tmp_path_factory.mktemp('compared'))


@pytest.fixture(scope='module')
def cut(drives, tmp_path_factory):
    """The same runs compared again, when the bag of one was cut."""
    return compare_drives(drives, tmp_path_factory.mktemp('cut'), {'damage': DAMAGE})


def on_the_road_of_the_paper(drives, speed_mps=None):
    """Return drives past the obstacles of `double_lane_change`, at its speed unless given."""
    still = np.zeros(101)
    scn = load_scenario('double_lane_change')
    obstacles = tuple(
        Obstacle(k, still + one.X, still + one.Y, still, still, one.r_obs)
        for k, one in enumerate(scn.obstacles.items, 1)
    )
    ((_, speed),) = scn.speeds
    scene = drives['mpcc'].scene._replace(obstacles=obstacles, desired_mps=speed_mps or speed)
    return {name: drive._replace(scene=scene) for name, drive in drives.items()}


def test_the_manoeuvre_of_the_paper_is_that_of_the_scenario():
    scn = load_scenario('double_lane_change')
    places = tuple((one.X, one.Y) for one in scn.obstacles.items)
    assert places == metrics_table.PAPER_OBSTACLES_M
    assert [speed for _, speed in scn.speeds] == [metrics_table.PAPER_SPEED_MPS]


def test_another_desired_speed_is_not_the_manoeuvre_of_the_paper(drives, tmp_path):
    faster = on_the_road_of_the_paper(drives, speed_mps=22.0)
    assert 'of_paper' not in compare_drives(faster, tmp_path).values


def test_the_name_of_a_scenario_makes_it_no_manoeuvre_of_the_paper(drives, tmp_path):
    named = {
        name: drive._replace(facts=drive.facts._replace(scenario='double_lane_change_of_mine'))
        for name, drive in drives.items()
    }
    assert 'of_paper' not in compare_drives(named, tmp_path).values


def test_the_file_holds_the_metrics_of_every_run_and_nothing_else(drives, comparison):
    values = json.loads(comparison.file.read_text())
    assert list(values) == ['scenario', 'runs']
    assert values['scenario'] == 'straight'
    assert values['runs'] == {name: metrics.compute_metrics(item) for name, item in drives.items()}


def test_every_panel_and_the_sheet_are_drawn_as_png_and_svg(comparison):
    wanted = set(comparison_figures.ALL)
    assert {path.stem for path in comparison.figures} == wanted
    assert len(comparison.figures) == 2 * len(wanted)
    for path in comparison.figures:
        data = path.read_bytes()
        assert data.startswith(b'\x89PNG' if path.suffix == '.png' else b'<?xml')
        assert len(data) > 10_000


def test_the_same_runs_give_the_same_figures(comparison, cut):
    for item, other in zip(comparison.figures, cut.figures, strict=True):
        assert item.read_bytes() == other.read_bytes(), item.name


@pytest.fixture(scope='module')
def runs(make_runs, drives):
    return make_runs(drives)


def test_a_figure_shows_every_run_in_its_own_colour(runs):
    colours = {run.look.colour for run in runs}
    assert len(colours) == len(runs)
    for name, panel in comparison_figures.PANELS.items():
        axes = comparison_figures.Figure().add_subplot()
        panel(axes, runs)
        drawn = {line.get_color() for line in axes.get_lines()}
        assert drawn >= colours, name
        assert axes.get_xlabel()
        assert axes.get_ylabel()
        assert '[' in axes.get_xlabel()


@pytest.mark.parametrize(
    ('name', 'marks'),
    [
        ('trajectories', ['coarse path', 'within the safety distance', 'circles overlap']),
        ('v2o', ['within the safety distance', 'circles overlap']),
        ('sideslip', []),
    ],
)
def test_a_legend_lists_what_its_panel_shows(runs, name, marks):
    (legend,) = comparison_figures.draw_figure(name, runs, '').legends
    assert [text.get_text() for text in legend.get_texts()] == [run.name for run in runs] + marks


def test_a_legend_of_long_names_is_within_the_figure(runs):
    long = panels.assign({f'{run.name}_with_a_long_name_of_its_own': run for run in runs})
    figure = comparison_figures.draw_figure('v2o', long, '')
    (legend,) = figure.legends
    figure.draw_without_rendering()
    box = legend.get_window_extent()
    assert box.x0 >= 0.0
    assert box.x1 <= figure.bbox.x1
    assert len({round(text.get_window_extent().y0) for text in legend.get_texts()}) > 1


def test_a_whole_car_is_seen_at_the_start(runs):
    axes = comparison_figures.Figure().add_subplot()
    comparison_figures.draw_trajectories(axes, runs)
    assert axes.get_xlim()[0] < -runs[0].drive.facts.outline.rear


def test_a_moving_obstacle_and_the_car_are_drawn_with_their_times(runs, make_drive):
    axes = comparison_figures.Figure().add_subplot()
    comparison_figures.draw_trajectories(axes, runs)
    times = {text.get_text() for text in axes.texts}
    assert {'0.0 s', '1.2 s', '2.4 s'} <= times
    still = comparison_figures.Figure().add_subplot()
    item = make_drive()
    comparison_figures.draw_trajectories(still, evaluate_runs({'mpcc': item}))
    assert not [text for text in still.texts if text.get_gid() == style.TIME_LABEL]


def test_a_panel_of_obstacles_without_any_says_so(make_drive):
    item = make_drive()
    axes = comparison_figures.Figure().add_subplot()
    panels.draw_v2o(axes, evaluate_runs({'mpcc': item}))
    assert 'no obstacle within 5 m' in {text.get_text() for text in axes.texts}


def test_small_changes_of_speed_look_small_and_accelerations_have_one_scale(runs):
    speed, gg = comparison_figures.Figure().subplots(1, 2)
    motion = runs[0].drive.motion
    wavy = motion._replace(vx=20.0 + 0.1 * np.sin(motion.x))
    wave = evaluate_runs({'mpcc': runs[0].drive._replace(motion=wavy)})
    comparison_figures.PANELS['velocity'](speed, wave)
    assert np.ptp(speed.get_ylim()) == pytest.approx(panels.LEAST_SPANS['velocity'])
    panels.draw_gg(gg, runs)
    assert gg.get_xlim() == gg.get_ylim()
    assert gg.get_aspect() == 1.0


def test_a_controller_keeps_its_colour_whoever_else_drives():
    assert (
        style.assign_colours(['mpcc', 'frenet'])['frenet']
        == style.assign_colours(['frenet'])['frenet']
    )
    many = [f'own_{k}' for k in range(12)]
    assert list(style.assign_colours(many)) == many


def test_the_table_has_a_row_per_metric_and_the_papers_solve_times(drives, tmp_path):
    of_paper = compare_drives(on_the_road_of_the_paper(drives), tmp_path)
    assert '<th scope="col">paper</th>' in of_paper.report.read_text()
    console = Console(file=io.StringIO(), width=140)
    show_comparison(of_paper, console)
    shown = console.file.getvalue()
    for row in METRICS.values():
        # the car stays on the road: how far it left it has no row
        title = row.title.partition('{')[0]
        assert (title in shown) == (row.name != 'beyond_edge_m'), row
    assert 'obstacle 1' in shown
    mean = next(line for line in shown.splitlines() if 'solve time, mean' in line)
    assert mean.split()[-1] == '15.6'
    most = next(line for line in shown.splitlines() if 'solve time, max' in line)
    assert most.split()[-1] == '18.6'
    assert 'comparison.json' in shown
    assert 'replaces' not in shown
    assert metrics_table.PAPER_NOTE.split()[-1] in shown


@pytest.mark.parametrize(('y_m', 'radius_m', 'is_seen'), [(-6.0, 3.0, True), (-40.0, 3.0, False)])
def test_an_obstacle_beside_the_cars_is_drawn_as_a_whole(make_runs, drives, y_m, radius_m, is_seen):
    drive = drives['mpcc']
    stands = drive.scene.obstacles[0]
    beside = stands._replace(y=np.full_like(stands.y, y_m), radius=radius_m)
    scene = drive.scene._replace(obstacles=(beside,))
    low, _ = comparison_figures.road_limits(make_runs({'mpcc': drive._replace(scene=scene)}))
    assert (low[1] <= y_m - radius_m) == is_seen


def test_another_scenario_has_no_column_of_the_paper(comparison):
    console = Console(file=io.StringIO(), width=140)
    show_comparison(comparison, console)
    shown = console.file.getvalue()
    assert metrics_table.PAPER_NOTE.split()[-1] not in shown
    (mean,) = (line for line in shown.splitlines() if 'solve time, mean' in line)
    assert '15.6' not in mean
    assert '<th scope="col">paper</th>' not in comparison.report.read_text()


def test_a_comparison_in_the_place_of_another_says_so_and_how_to_keep_both(comparison):
    again = comparison._replace(replaced=('mpcc', 'frenet'))
    console = Console(file=io.StringIO(), width=140)
    show_comparison(again, console)
    said = 'replaces the comparison that was there, of mpcc, frenet; --out DIR keeps both'
    assert said in console.file.getvalue()


def test_ticks_in_which_the_solver_stopped_early_are_counted_below_the_table(comparison):
    runs = {name: dict(values) for name, values in comparison.values['runs'].items()}
    runs['own'] |= {'stopped_early': 3, 'ticks': 160}
    console = Console(file=io.StringIO(), width=140)
    show_comparison(comparison._replace(values=comparison.values | {'runs': runs}), console)
    lines = [line for line in console.file.getvalue().splitlines() if 'stopped early' in line]
    assert lines == ['own: solver stopped early in 3 of 160 ticks']


def test_the_runs_of_the_comparison_that_was_there_are_read_from_it(drives, comparison, tmp_path):
    assert comparison.replaced == ()
    (tmp_path / 'comparison.json').write_text(comparison.file.read_text())
    only = {'mpcc': drives['mpcc']}
    assert compare_drives(only, tmp_path).replaced == tuple(drives)


def test_three_controllers_fit_into_a_plain_terminal(make_drive):
    console = Console(file=io.StringIO(), width=80)
    runs = dict.fromkeys(('mpcc', 'mpcc_no_ca', 'frenet'), metrics.compute_metrics(make_drive()))
    console.print(metrics_table.build_table({'scenario': 's', 'runs': runs}))
    assert '…' not in console.file.getvalue()
    assert 'm/s²' in console.file.getvalue()


def test_many_runs_are_rows_of_the_table(drives, tmp_path):
    many = {f'own@{k:02d}': drives['own'] for k in range(30)}
    console = Console(file=io.StringIO(), width=80)
    show_comparison(compare_drives(many, tmp_path), console)
    table, verdicts = console.file.getvalue().split('own@00: ')
    assert max(map(len, table.splitlines())) <= 80
    assert [line.split()[0] for line in table.splitlines()[-30:]] == list(many)
    assert 'replaces' not in verdicts
    show_comparison(compare_drives(many, tmp_path), console)
    assert 'replaces the comparison that was there, of 30 runs' in console.file.getvalue()


def test_what_a_run_does_not_have_is_a_dash(make_drive):
    console = Console(file=io.StringIO(), width=140)
    console.print(
        metrics_table.build_table(
            {'scenario': 's', 'runs': {'mpcc': metrics.compute_metrics(make_drive())}}
        )
    )
    lines = console.file.getvalue().splitlines()
    nearest = next(line for line in lines if 'min distance to obstacle' in line)
    assert '–' in nearest


def test_a_bag_that_was_cut_is_said_once_and_marked_in_the_table(cut):
    console = Console(file=io.StringIO(), width=140)
    show_comparison(cut, console)
    lines = console.file.getvalue().splitlines()
    assert lines[0] == DAMAGE['mpcc']
    (head,) = (line for line in lines if 'metric' in line)
    assert head.split()[:6] == ['metric', 'unit', 'mpcc,', 'bag', 'cut', 'mpcc_no_ca']
    assert json.loads(cut.file.read_text())['damage'] == DAMAGE


def test_a_path_that_is_no_bag_is_one_line(tmp_path, capsys):
    assert cli.main(['compare', str(tmp_path / 'nothing')]) == 1
    output = capsys.readouterr().err
    assert output.startswith('error: ')
    assert output.count('\n') == 1
    assert 'nothing' in output


def test_what_is_no_bag_is_left_out_of_a_comparison_with_a_line(tmp_path, capsys):
    (tmp_path / 'report.html').touch()
    (tmp_path / 'mpcc').mkdir()
    (tmp_path / 'mpcc/mpcc_0.mcap').touch()
    assert cli.main(['compare', *map(str, sorted(tmp_path.iterdir()))]) == 1
    error = capsys.readouterr().err
    assert f'left out, since they are no bags: {tmp_path / "report.html"}\n' in error
    assert 'mpcc_0.mcap: the file is empty' in error


def test_the_commands_of_the_interface_exist(capsys):
    assert {'compare', 'info', 'repair'} <= set(cli.COMMANDS)
    for command in cli.COMMANDS:
        with pytest.raises(SystemExit) as ended:
            cli.main([command, '--help'])
        assert ended.value.code == 0
        assert f'bags {command}' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('paths', 'recorded', 'names'),
    [
        (['a/mpcc', 'a/frenet'], ['mpcc', 'frenet'], ['mpcc', 'frenet']),
        (['a/mpcc', 'a/mpcc@1'], ['mpcc', 'mpcc'], ['mpcc', 'mpcc@1']),
        (['a/mpcc', 'b/mpcc', 'a/x'], ['mpcc', 'mpcc', 'frenet'], ['a/mpcc', 'b/mpcc', 'frenet']),
        (
            ['a/mpcc', 'a/frenet', 'b/x'],
            ['frenet', 'frenet', 'mpcc'],
            ['a/mpcc', 'a/frenet', 'mpcc'],
        ),
        (['a/mpcc/mpcc_0.mcap', 'a/mpcc@1'], ['mpcc', 'mpcc'], ['mpcc', 'mpcc@1']),
    ],
)
def test_runs_of_one_controller_are_called_after_their_folders(paths, recorded, names):
    assert comparison_module.name_runs(paths, recorded) == names


def test_a_bag_that_is_given_twice_is_refused():
    with pytest.raises(BagError, match='the bag is given twice'):
        comparison_module.name_runs(['a/mpcc/', 'a/mpcc'], ['mpcc', 'mpcc'])
