"""Bags in; one JSON file, CSV, a table, figures and a page out: what a user reads in each."""

import csv
import io
import json

import numpy as np
import pytest
from evaluated_drives import compare_drives, evaluate_runs
from rich.console import Console
from straight_drive import drive_of, obstacle, straight_scene

from bags import cli, metrics_table
from bags.errors import BagError
from bags.evaluation import metrics
from bags.evaluation.metrics import registry
from bags.figures import comparison_figures
from bags.report import comparison as comparison_module
from bags.report.comparability import check_comparable
from bags.report.comparison import show_comparison
from experiments.run import node_graph, run_and_compare
from scenario_publisher.scenario import load as load_scenario

DAMAGE = {'mpcc': 'mpcc_0.mcap: damaged at byte 7 (cut); read up to there'}
THREE = ('mpcc', 'mpcc_no_ca', 'frenet')


@pytest.fixture(scope='module')
def drives(drives):
    """Return a sound drive past two obstacles, one that left the road, and one that spun."""
    spun = drive_of(scene=drives['mpcc'].scene, controller='spun')
    angle = np.radians(2.0 * spun.motion.x)
    motion = spun.motion._replace(vx=20.0 * np.cos(angle), vy=20.0 * np.sin(angle))
    return {
        'mpcc': drives['mpcc'],
        'off': drive_of(scene=drives['mpcc'].scene, controller='off', y=lambda x: x / 10.0),
        'spun': spun._replace(motion=motion),
    }


@pytest.fixture(scope='module')
def comparison(drives, tmp_path_factory):
    return compare_drives(drives, tmp_path_factory.mktemp('compared'))


@pytest.fixture(scope='module')
def again(drives, comparison, tmp_path_factory):
    """Return the same runs compared in the place of another comparison, when a bag was cut."""
    folder = tmp_path_factory.mktemp('cut')
    (folder / 'comparison.json').write_text(comparison.file.read_text())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(comparison_figures, 'write_figures', lambda *given: [given[2]])
        cut = evaluate_runs(drives)
        cut[0].damage = DAMAGE['mpcc']
        return comparison_module.compare_runs(cut, folder)


@pytest.fixture(scope='module')
def runs(comparison):
    return comparison.values['runs']


def printed(comparison, width=140):
    console = Console(file=io.StringIO(), width=width)
    show_comparison(comparison, console)
    return console.file.getvalue()


def table_of(runs, width=80):
    console = Console(file=io.StringIO(), width=width)
    console.print(metrics_table.build_table({'scenario': 's', 'runs': runs}))
    return console.file.getvalue()


def test_the_files_hold_the_metrics_of_every_run_digit_for_digit(drives, comparison, runs):
    values = json.loads(comparison.file.read_text())
    assert list(values) == ['scenario', 'runs']
    assert values['scenario'] == 'straight'
    assert values['runs'] == runs
    assert runs == {name: metrics.compute_metrics(item) for name, item in drives.items()}
    rows = {row['metric']: row for row in csv.DictReader(comparison.sheet.open())}
    for name, result in runs.items():
        assert float(rows['rms_contouring_m'][name]) == result['rms_contouring_m']
        assert float(rows['solve_ms.p99'][name]) == result['solve_ms']['p99']
        assert rows['completed'][name] == str(result['completed']).lower()
        assert rows['brake_onset_at_m'][name] == ''
    uneven = {'a': {'overshoots': [{'x_m': 1.5}]}, 'b': {'overshoots': []}}
    assert metrics_table.metrics_csv(uneven) == 'metric,a,b\novershoots.0.x_m,1.5,\n'


def test_every_verdict_is_below_the_table_and_in_the_report(comparison, runs):
    page, shown = ' '.join(comparison.report.read_text().split()), printed(comparison)
    for name, result in runs.items():
        assert f'{name}: {result["verdict"]}\n' in shown
        assert f'<strong>{name}</strong>: {result["verdict"]}</li>' in page
    assert 'comparison.json' in shown
    assert 'replaces' not in shown


def test_nothing_is_green_beside_a_lost_car(runs):
    cells = {line.title: line.cells for line in metrics_table.table_lines(runs)}
    for title, (sound, *lost) in cells.items():
        assert True not in [cell.good for cell in lost], title
        if title in ('completed', 'collided', 'left the road', 'lost control'):
            assert sound.good is True, title
    assert [cell.text for cell in cells['lost control']] == ['no', 'no', 'spun']
    assert [cell.text for cell in cells['left the road']] == ['no', 'yes', 'no']
    assert cells['lost control'][2].good is cells['left the road'][1].good is False
    # backwards a car reaches any angle; what is recorded stays
    sound, _, spun = cells['peak sideslip angle']
    assert (sound.text, spun.text) == (f'{runs["mpcc"]["peak_sideslip_deg"]:.1f}', 'spun')
    assert runs['spun']['peak_sideslip_deg'] > 90.0


def test_what_a_run_does_not_have_is_a_dash_and_what_no_run_has_is_no_row(runs):
    alone = table_of({'mpcc': metrics.compute_metrics(drive_of())})
    (nearest,) = (line for line in alone.splitlines() if 'min distance to obstacle' in line)
    assert '–' in nearest
    assert 'outline beyond the edge' not in alone
    assert 'outline beyond the edge' in table_of(runs)


def test_the_table_has_a_row_per_metric_and_fits_into_a_plain_terminal(runs):
    for result in (runs['mpcc'], runs['off'] | {'lost': True, 'lost_how': 'spun'}):
        shown = table_of(dict.fromkeys(THREE, result))
        assert max(map(len, shown.splitlines())) <= 80
        assert '…' not in shown
    for row in registry.METRICS.values():
        assert row.title.partition('{')[0] in shown, row
    assert 'obstacle 1' in shown
    assert 'm/s²' in shown


def test_many_runs_are_rows_of_the_table(runs):
    many = {f'own@{k:02d}': runs['mpcc'] for k in range(30)}
    shown = table_of(many)
    assert max(map(len, shown.splitlines())) <= 80
    assert [line.split()[0] for line in shown.splitlines()[-30:]] == list(many)


def test_a_cut_bag_and_a_comparison_that_is_replaced_are_said(again):
    assert again.replaced == ('mpcc', 'off', 'spun')
    shown = printed(again)
    assert shown.splitlines()[0] == DAMAGE['mpcc']
    (head,) = (line for line in shown.splitlines() if 'metric' in line and 'unit' in line)
    assert head.split() == ['metric', 'unit', 'mpcc,', 'bag', 'cut', 'off', 'spun']
    assert json.loads(again.file.read_text())['damage'] == DAMAGE
    said = 'replaces the comparison that was there, of mpcc, off, spun; --out DIR keeps both'
    assert said in shown
    many = printed(again._replace(replaced=tuple(map(str, range(30)))))
    assert 'replaces the comparison that was there, of 30 runs' in many


def test_ticks_in_which_the_solver_stopped_early_are_counted_below_the_table(comparison, runs):
    early = runs | {'off': runs['off'] | {'stopped_early': 3, 'ticks': 160}}
    shown = printed(comparison._replace(values=comparison.values | {'runs': early}))
    lines = [line for line in shown.splitlines() if 'stopped early' in line]
    assert lines == ['off: solver stopped early in 3 of 160 ticks']


@pytest.mark.parametrize(
    ('faster', 'named', 'of_paper'),
    [(0.0, 'mine', True), (1.2, 'mine', False), (1.2, 'double_lane_change', False)],
)
def test_the_manoeuvre_of_the_paper_has_its_solve_times_whatever_it_is_called(
    undrawn, tmp_path, faster, named, of_paper
):
    scenario = load_scenario('double_lane_change')
    ((_, speed),) = scenario.speeds
    crowd = [
        obstacle(k, item.X, item.Y, radius=item.r_obs)
        for k, item in enumerate(scenario.obstacles.items, 1)
    ]
    scene = straight_scene(crowd)._replace(desired_mps=speed + faster)
    result = compare_drives({'mpcc': drive_of(scene=scene, scenario=named)}, tmp_path)
    shown = printed(result)
    assert ('of_paper' in result.values) == of_paper
    assert ('<th scope="col">paper</th>' in result.report.read_text()) == of_paper
    assert (metrics_table.PAPER_NOTE.split()[-1] in shown) == of_paper
    lines = [line.split()[-1] for line in shown.splitlines() if 'solve time, ' in line]
    assert (lines[0], lines[-1]) == (('15.6', '18.6') if of_paper else ('5.0', '5.0'))


def test_figures_are_drawn_and_the_same_runs_give_the_same(drives, comparison, tmp_path):
    singly, other = tmp_path / 'singly', tmp_path / 'other'
    singly.mkdir()
    other.mkdir()
    write, runs = comparison_figures.write_figures, evaluate_runs(drives)
    figures = write(runs, 'straight', singly, singly=True)
    assert {path.stem for path in figures} == set(comparison_figures.ALL)
    assert len(figures) == 2 * len(comparison_figures.ALL)
    drawn = {path.name: path.read_bytes() for path in figures}
    for name, data in drawn.items():
        assert data.startswith(b'\x89PNG' if name.endswith('.png') else b'<?xml')
        assert len(data) > 10_000
    # a later sheet alone leaves no panel of other runs beside it
    assert write(runs, 'straight', singly) == [singly / 'comparison.png'] == [*singly.iterdir()]
    (sheet,) = comparison.figures
    assert sheet.read_bytes() == drawn[sheet.name]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(comparison_figures, 'ALL', ('trajectories', 'v2o'))
        again = write(runs, 'straight', other, singly=True)
    assert [path.read_bytes() for path in again] == [drawn[path.name] for path in again]


# which runs are comparable, and what they are called
PLANT = {'friction': 1.0, 'car.body.mass_kg': 1850.0, 'mode': 'lockstep', 'tyre_set': 'a.yaml'}


def info(scenario='s', sha='1', **plant):
    entries = {'plant': {**PLANT, **plant}, 'controller': {'weight': 1.0}}
    return {'scenario': scenario, 'scenario_sha256': sha, 'parameters': json.dumps(entries)}


@pytest.mark.parametrize(
    ('other', 'said'),
    [
        (info(mode='realtime', tyre_set='/elsewhere/a.yaml'), ''),
        (info(scenario='t', sha='2'), "different scenarios ('s' and 't')"),
        (info(sha='2'), "two versions of 's'"),
        (info(friction=0.9), 'different plants (friction 1.0 and 0.9)'),
        (info(**{f'car.p{k}': 1.0 for k in range(9)}), 'and 6 more'),
        ({'scenario': 's', 'scenario_sha256': '1'}, 'car.body.mass_kg 1850.0 and unknown'),
    ],
)
def test_another_road_or_car_does_not_compare_and_the_difference_is_named(other, said):
    if not said:
        check_comparable(['a', 'b', 'c'], [info(), info(), other])
        return
    with pytest.raises(BagError) as refused:
        check_comparable(['a', 'b', 'c'], [info(), info(), other])
    for text in (said, 'a and c', '--force'):
        assert text in str(refused.value)


@pytest.mark.parametrize(
    ('paths', 'recorded', 'names'),
    [
        (['a/mpcc', 'a/frenet'], ['mpcc', 'frenet'], ['mpcc', 'frenet']),
        (['a/mpcc', 'a/mpcc@1'], ['mpcc', 'mpcc'], ['mpcc', 'mpcc@1']),
        (['a/mpcc', 'b/mpcc', 'a/x'], ['mpcc', 'mpcc', 'frenet'], ['a/mpcc', 'b/mpcc', 'frenet']),
        (['a/mpcc/mpcc_0.mcap', 'a/mpcc@1'], ['mpcc', 'mpcc'], ['mpcc', 'mpcc@1']),
    ],
)
def test_runs_of_one_controller_are_called_after_their_folders(paths, recorded, names):
    assert comparison_module.name_runs(paths, recorded) == names
    with pytest.raises(BagError, match='the bag is given twice'):
        comparison_module.name_runs([*paths, f'{paths[0]}/'], [*recorded, 'own'])


# a metric costs one function: table, JSON, CSV and list follow from its registration


def test_a_registered_metric_is_everywhere(undrawn, tmp_path, capsys):
    before = dict(registry.METRICS)
    try:

        @registry.metric('top speed', 'km/h', 1)
        def top_speed_kmph(run):
            """Largest speed over ground."""
            return 3.6 * float(run.series.speed.max())

        compared = compare_drives({'mpcc': drive_of()}, tmp_path)
        with pytest.raises(SystemExit) as ended:
            cli.main(['compare', '--list-metrics'])
        with pytest.raises(ValueError, match='top_speed_kmph is registered already'):
            registry.metric()(top_speed_kmph)
        (line,) = (
            x for x in metrics_table.table_lines(compared.values['runs']) if x.title == 'top speed'
        )
    finally:
        registry.METRICS.clear()
        registry.METRICS.update(before)
    assert compared.values['runs']['mpcc']['top_speed_kmph'] == pytest.approx(72.0)
    assert 'top_speed_kmph,7' in compared.sheet.read_text()
    assert (line.unit, line.cells[0].text) == ('km/h', '72.0')
    assert 'top speed' in compared.report.read_text()
    assert not ended.value.code
    listed = capsys.readouterr().out
    assert 'top_speed_kmph [km/h]: Largest speed over ground.' in listed
    assert 'completed: Whether the car reached' in listed
    assert all(metric.meaning for metric in registry.METRICS.values())


@pytest.mark.parametrize('earlier', [(), (0.0,), (0.1,)])
@pytest.mark.parametrize(('slope', 'code'), [(0.1, 1), (0.0, 0)])
def test_experiments_run_says_why_it_fails_where_only_the_verdict_is_the_reason(
    undrawn, write_bag, tmp_path, monkeypatch, slope, code, earlier
):
    bag = write_bag(drive_of(y=lambda x: x * slope))
    # with which it is compared: how they ended changes nothing
    others = [write_bag(drive_of(y=lambda x, k=k: x * k), 'other') for k in earlier]
    monkeypatch.setattr(run_and_compare, 'find_earlier', lambda *given: others)
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
