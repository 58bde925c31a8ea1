"""A recording as a run: metrics, signals, figure, and what is said when something is missing."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from straight_drive import obstacle, straight_scene

import bags
from bags.errors import BagError, InvalidMessagesWarning
from bags.evaluation import metrics, signals
from bags.evaluation.metrics.registry import METRICS
from bags.run import UnknownNameError

ROOT = Path(__file__).parents[3]
UNITS = {
    '_mps3': 'm/s³',
    '_mps2': 'm/s²',
    '_mps': 'm/s',
    '_deg': 'deg',
    '_ms': 'ms',
    '_s': 's',
    '_m': 'm',
    '_rad': 'rad',
    '_n': 'N',
}


def unit_of(name):
    name = name.replace('_per_obstacle', '').replace('_per_edge', '')
    return next((unit for ending, unit in UNITS.items() if name.endswith(ending)), '')


def test_metrics_are_those_of_the_comparison(run):
    assert dict(run.metrics) == metrics.compute_metrics(run.drive)
    assert run.metrics['min_v2o_per_obstacle_m.7'] == run.metrics['min_v2o_m']
    assert run.metrics.unit('min_v2o_per_obstacle_m.7') == 'm'
    assert 'circles of the car' in run.metrics.meaning('min_v2o_m')
    assert run.metrics.frame().loc['solve_ms.max', 'unit'] == 'ms'
    assert 'min distance to obstacle' in repr(run.metrics)


def test_the_unit_of_a_metric_and_of_a_signal_is_that_of_its_name():
    for name, metric in METRICS.items():
        assert metric.unit == unit_of(name) or not unit_of(name), name
    for name, signal in signals.SIGNALS.items():
        assert signal.unit == (unit_of(name) or '-'), name
        assert signal.meaning


def test_signals_are_those_by_which_the_metrics_judge(run):
    frame, values = run.signals, run.metrics
    assert len(frame) == len(run.frame('/vehicle/odometry'))
    assert frame.index.name == 't_s'
    assert frame['v2o_m.7'].min() == values['min_v2o_m']
    assert frame['v2e_m.left'].min() == values['min_v2e_per_edge_m']['left']
    assert frame['outline_gap_m.7'].min() == values['min_outline_gap_m']
    peak_deg = np.degrees(frame['sideslip_rad'].abs().max())
    assert peak_deg == pytest.approx(values['peak_sideslip_deg'], rel=1e-12)
    assert np.sqrt((frame['contouring_m'] ** 2).mean()) == pytest.approx(values['rms_contouring_m'])
    assert frame['ay_mps2'].abs().max() == values['peak_lat_acc_mps2']
    use = np.hypot(frame['ax_mps2'], frame['ay_mps2']) / 9.81
    assert np.allclose(frame['friction_use'], use, rtol=1e-12)
    assert frame['steer_rad'].max() == pytest.approx(0.1, abs=1e-4)


def test_the_controller_and_its_judge_give_the_contouring_error_one_sign():
    driven = bags.load(ROOT / 'bags/reference/double_lane_change/mpcc')
    reported = driven.frame('/controller/why')['error.con'].dropna()
    judged = driven.signals['contouring_m']
    assert np.ptp(judged) > 0.5  # on both sides of the path
    # the controller projects onto a spline, the judge onto the polyline
    assert np.interp(reported.index, judged.index, judged) == pytest.approx(reported, abs=0.01)
    reports = driven.frame('/controller/why').set_index('stamp_ns')['friction.front']
    shown = driven.signals['model_friction_use.front'].to_numpy()
    at = np.searchsorted(driven.stamp_ns, reports.index)
    assert np.array_equal(shown[at], reports, equal_nan=True)


def test_a_set_point_is_due_a_period_after_its_state(second):
    """Between two set-points the command is a straight line, as the actuators follow it."""
    table = second.table('/controller/command')
    at_ns = table.stamp_ns[:-1] + 75_000_000
    due = signals.interpolate(at_ns, table.stamp_ns + 50_000_000, table.steer_rad)
    assert np.allclose(due, (table.steer_rad[:-1] + table.steer_rad[1:]) / 2)
    # and nothing is invented outside of the recorded time
    values = signals.interpolate(
        np.array([9, 10, 15, 21]), np.array([10, 20]), np.array([1.0, 2.0])
    )
    assert np.array_equal(values, [np.nan, 1.0, 1.5, np.nan], equal_nan=True)


def test_a_run_is_one_line_and_one_that_cannot_be_evaluated_still_has_frames(run, second):
    text = repr(run)
    assert text.startswith("Run('mpcc', straight, 2.50 s: did not reach the finish line")
    assert len(text) < 200
    assert run.parameters['controller.safety.obstacle_m'] == 0.5
    assert 'python' in run.metadata['versions']
    assert repr(second) == "Run('one second', one second, 1.00 s: 19 topics)"
    with pytest.raises(BagError, match='parameters'):
        second.metrics  # noqa: B018
    assert len(second.frame('/vehicle/imu')) == 100


def without(samples):
    return type(samples)(*(column[:0] for column in samples))


@pytest.mark.parametrize(
    ('part', 'absent'),
    [
        ('', {'tyre_use'}),  # no message of the wheels
        ('inputs', {'tyre_use', 'steer_rad', 'front_x_n', 'rear_x_n'}),
        ('accelerations', {'tyre_use', 'ax_mps2', 'ay_mps2', 'friction_use'}),
    ],
)
def test_signals_of_topics_that_were_not_recorded_are_absent(make_drive, write_bag, part, absent):
    drive = make_drive(metres=20.0, scene=straight_scene([obstacle(7, 40.0, -3.5)]))
    if part:
        drive = drive._replace(**{part: without(getattr(drive, part))})
    named = {name.partition('.')[0] for name in bags.load(write_bag(drive)).signals}
    assert named == set(signals.SIGNALS) - absent


def test_what_a_recording_lacks_is_named(make_drive, write_bag):
    drive = make_drive(metres=20.0)
    unseen = drive.scene._replace(obstacle_stamp_ns=drive.scene.obstacle_stamp_ns[:0])
    run = bags.load(write_bag(drive._replace(scene=unseen)))
    with pytest.raises(BagError, match=r'no message of.*/scenario/obstacles'):
        run.signals  # noqa: B018


def test_unknown_names_have_a_suggestion(second, run):
    with pytest.raises(UnknownNameError, match=r'did you mean .*/vehicle/odometry'):
        second.frame('/vehicle/odometri')
    with pytest.raises(KeyError, match='min_v2o_m'):
        run.metrics['min_v2o']
    with pytest.raises(BagError, match="did you mean 'v2o'"):
        run.figure('v2oo')


def test_messages_that_break_the_contract_are_left_out_with_a_warning(make_drive, write_bag):
    drive = make_drive(metres=20.0)
    x = drive.motion.x.copy()
    x[5] = 2e5
    folder = write_bag(drive._replace(motion=drive.motion._replace(x=x)), 'broken')
    with pytest.warns(InvalidMessagesWarning, match='1 invalid messages of /vehicle/odometry'):
        run = bags.load(folder)
    assert len(run.frame('/vehicle/odometry')) == len(x) - 1
    assert len(run.faults) == 1


def test_a_figure_is_shown_by_a_notebook_without_pyplot(run):
    figure = run.figure('v2o')
    assert figure._repr_png_().startswith(b'\x89PNG')
    assert figure.axes[0].get_ylabel() == '$D_{V2O}$ [m]'


def test_several_runs_are_one_table(recorded):
    run, own = recorded
    runs = bags.compare(run, run, own)
    assert runs.labels == ['mpcc', 'mpcc (2)', 'own']
    frame = runs.frame()
    assert list(frame.index) == runs.labels
    assert frame.loc['own', 'min_v2o_m'] == own.metrics['min_v2o_m']
    assert len(runs[1:]) == 2
    assert runs[0].controller == 'mpcc'
    assert 'min distance to obstacle' in repr(runs)
    with pytest.raises(KeyError, match="did you mean 'own'"):
        runs['owm']
    with pytest.raises(BagError, match='one or more'):
        bags.compare()


def test_a_report_of_runs(undrawn, recorded, tmp_path):
    report = bags.compare(*recorded).report(tmp_path / 'out')
    values = json.loads((tmp_path / 'out/comparison.json').read_text())
    assert report.stat().st_size > 100_000
    assert list(values['runs']) == ['mpcc', 'own']
    assert values['runs']['own'] == dict(recorded[1].metrics)


def test_import_is_free_of_pandas_and_matplotlib():
    """Nodes import this package, too."""
    code = 'import bags, sys; print(*sys.modules); bags.load'
    loaded = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert not {'numpy', 'pandas', 'matplotlib', 'bags.storage'} & set(loaded)
    assert {'load', 'compare', 'Run', 'RunSet'} <= set(dir(bags))
    with pytest.raises(AttributeError, match='no attribute'):
        bags.lod  # noqa: B018


def test_meanings_are_shown_whole_and_say_how_the_columns_of_members_are_called(run):
    described = run.describe()
    for columns in (described, described.loc[['v2o_m']]):
        assert "of the car's circles to each obstacle; not-a-number while absent. " in repr(columns)
        assert '...' not in columns._repr_html_()
    several = {name.partition('.')[0]: name for name in run.signals if '.' in name}
    assert {'v2o_m', 'v2e_m', 'outline_gap_m', 'model_friction_use'} <= {*several}
    for name, meaning in described['meaning'].items():
        assert (f', as {name}.' in meaning) == (name in several or name == 'tyre_use')
