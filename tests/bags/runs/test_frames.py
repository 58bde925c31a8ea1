"""The messages of each topic as a DataFrame: every number in one flat column."""

import sys

import numpy as np
import pytest
from one_second import FOUR, SLIPS, every_message

from bags import frames
from bags.storage.columns import TOPICS, Columns, names
from msgs_yaml import contract

SENT = every_message()


def test_numbers_of_the_state_by_time(second):
    frame = second.frame('/vehicle/odometry')
    assert frame.index.name == 't_s'
    assert frame.index[-1] == pytest.approx(0.999)
    assert list(frame) == ['stamp_ns', *names('/vehicle/odometry')[2:]]
    assert frame['y_m'].iloc[3] == SENT['/vehicle/odometry'][3].Y
    assert frame['stamp_ns'].dtype == np.int64


@pytest.mark.parametrize('topic', ['/vehicle/actuators', '/vehicle/wheels'])
def test_wheels_have_a_column_each(second, topic):
    frame = second.frame(topic)
    assert not frame.select_dtypes(object).columns.size
    assert tuple(frame.filter(like='torque_nm.').iloc[0]) == FOUR
    assert list(frame.filter(like='torque_nm.')) == [
        f'torque_nm.{wheel}' for wheel in ('fl', 'fr', 'rl', 'rr')
    ]


def test_slip_and_slip_angle_of_a_wheel(second):
    frame = second.frame('/vehicle/wheels')
    assert (frame['slip.fr'] == SLIPS[1]).all()
    assert (frame['slip_angle_rad.fl'] == SLIPS[3]).all()
    assert frame['load_n.fl'].iloc[5] == 4005.0


def test_obstacles_have_columns_by_their_id(second):
    frame = second.frame('/scenario/obstacles')
    assert frame['x_m.2'].iloc[4] == 56.0
    assert (frame['vx_mps.2'] == -20.0).all()
    assert (frame['radius_m.1'] == 1.0).all()
    assert list(frame)[:3] == ['stamp_ns', 'x_m.1', 'y_m.1']


def test_an_obstacle_is_not_a_number_while_it_is_absent(second):
    table = second.table('/scenario/obstacles')
    first = table.values[0]._replace(items=table.values[0].items[1:])
    frame = frames.frame_of(
        '/scenario/obstacles', Columns(table.stamp_ns, table.t_s, values=(first, *table.values[1:]))
    )
    assert np.isnan(frame['x_m.1'].iloc[0])
    assert frame['x_m.1'].iloc[1] == 40.0


def test_a_prediction_has_a_row_per_stage(second):
    frame = second.frame('/controller/prediction')
    assert frame.index.names == ['t_s', 'stage']
    third = frame.loc[frame.index.levels[0][3]]
    sent = SENT['/controller/prediction'][3]
    assert np.array_equal(third['x_m'], sent.X)
    assert np.array_equal(third['ahead_s'], sent.t)
    assert len(frame) == sum(len(value.X) for value in SENT['/controller/prediction'])


def test_road_edges_have_a_row_per_point(second):
    frame = second.frame('/scenario/road_edges')
    (sent,) = SENT['/scenario/road_edges']
    assert np.array_equal(frame.loc[0.0, 'right'][['x_m', 'y_m']], sent.right)


def test_the_coarse_path_has_the_time_of_each_point(second):
    frame = second.frame('/scenario/reference')
    (sent,) = SENT['/scenario/reference']
    assert np.array_equal(frame['passes_s'], sent.t)
    assert np.array_equal(frame['yaw_rad'], sent.psi)


def test_a_report_has_a_column_per_key(second):
    frame = second.frame('/controller/why')
    assert frame['cost.con'].tolist() == [w.values['cost.con'] for w in SENT['/controller/why']]
    assert set(frame['rung']) == {'solved'}
    assert second.frame('/diagnostics')['node'].tolist() == ['plant']


@pytest.mark.parametrize('topic', frames.FRAMED)
def test_every_topic_has_a_frame_whose_columns_are_described(second, topic):
    frame, described = second.frame(topic), second.describe(topic)
    assert len(frame) >= len(SENT[topic])
    assert set(described.index) - {frames.REPORT} <= {name.partition('.')[0] for name in frame}
    if frames.REPORT not in described.index:
        assert {name.partition('.')[0] for name in frame} == set(described.index)


def test_every_topic_that_is_decoded_has_a_frame():
    drawn = {name for name in contract.load().topics if name.startswith('/markers/')}
    assert set(frames.FRAMED) == set(contract.load().topics) - drawn


@pytest.mark.parametrize('topic', TOPICS)
def test_units_are_those_of_the_contract(topic):
    described = frames.describe(topic)
    for name, ending in {
        'yaw_rad': 'rad',
        'ax_mps2': 'm/s²',
        'load_n': 'N',
        'torque_nm': 'N m',
    }.items():
        assert name not in described.index or described.loc[name, 'unit'] == ending
    assert described['unit'].all()


def test_without_pandas_the_extra_is_named(second, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pandas', None)
    with pytest.raises(ImportError, match=r'bags\[frames\]'):
        second.frame('/vehicle/odometry')
    # numpy columns need none
    assert len(second.table('/vehicle/odometry').x_m) == 1000
