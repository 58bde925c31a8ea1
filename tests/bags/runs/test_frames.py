"""The messages of each topic as a DataFrame: every number in one flat column."""

import sys

import numpy as np
import pytest
from one_second import FOUR, SLIPS, every_message

from bags import frames
from bags.storage.columns import TOPICS, Columns, names
from msgs_yaml import contract

SENT = every_message()
REFERENCE, EDGES = SENT['/scenario/reference'][0], SENT['/scenario/road_edges'][0]
COSTS = [why.values['cost.con'] for why in SENT['/controller/why']]


@pytest.mark.parametrize(
    ('topic', 'column', 'expected'),
    [
        ('/vehicle/odometry', 'y_m', [state.Y for state in SENT['/vehicle/odometry']]),
        ('/vehicle/wheels', 'slip.fr', [SLIPS[1]] * 100),
        ('/vehicle/wheels', 'slip_angle_rad.fl', [SLIPS[3]] * 100),
        ('/vehicle/wheels', 'load_n.fl', 4e3 + np.arange(100)),
        ('/vehicle/actuators', 'torque_nm.rr', [FOUR[3]] * 1000),
        ('/scenario/obstacles', 'x_m.2', 60.0 - np.arange(20)),
        ('/scenario/obstacles', 'vx_mps.2', [-20.0] * 20),
        ('/scenario/obstacles', 'radius_m.1', [1.0] * 20),
        ('/scenario/reference', 'passes_s', REFERENCE.t),
        ('/scenario/reference', 'yaw_rad', REFERENCE.psi),
        ('/scenario/road_edges', 'y_m', np.concatenate([EDGES.left[:, 1], EDGES.right[:, 1]])),
        ('/controller/prediction', 'x_m', np.ravel([p.X for p in SENT['/controller/prediction']])),
        ('/controller/prediction', 'ahead_s', np.tile(REFERENCE.t, 20)),
        ('/controller/why', 'cost.con', COSTS),
        ('/controller/why', 'rung', ['solved'] * 20),
        ('/diagnostics', 'node', ['plant']),
    ],
)
def test_a_column_has_the_numbers_that_were_sent(second, topic, column, expected):
    frame = second.frame(topic)
    # a heading is sent as a quaternion, a time as whole ns
    assert frame[column].tolist() == pytest.approx(list(expected), rel=1e-12)
    assert frame['stamp_ns'].dtype == np.int64
    assert frame.index.get_level_values('t_s')[0] == 0.0


def test_a_frame_is_indexed_by_time_and_a_line_by_its_points(second):
    assert second.frame('/vehicle/odometry').index[-1] == pytest.approx(0.999)
    assert tuple(second.frame('/vehicle/odometry'))[1:] == names('/vehicle/odometry')[2:]
    assert second.frame('/controller/prediction').index.names == ['t_s', 'stage']
    edges = second.frame('/scenario/road_edges')
    assert np.array_equal(edges.loc[0.0, 'right'][['x_m', 'y_m']], EDGES.right)
    assert edges.loc[0.0, 'right'].index.tolist() == [*range(len(EDGES.right))]
    assert list(second.frame('/scenario/obstacles'))[:3] == ['stamp_ns', 'x_m.1', 'y_m.1']
    wheels = [f'torque_nm.{wheel}' for wheel in ('fl', 'fr', 'rl', 'rr')]
    for topic in ('/vehicle/actuators', '/vehicle/wheels'):
        assert list(second.frame(topic).filter(like='torque_nm.')) == wheels


@pytest.mark.parametrize(
    ('topic', 'rows'),
    [('/controller/prediction', len(REFERENCE.X)), ('/scenario/road_edges', 2 * len(EDGES.left))],
)
def test_messages_of_one_stamp_are_all_in_the_frame(second, topic, rows):
    value = second.table(topic).values[0]
    repeated = Columns(np.zeros(2, np.int64), np.zeros(2), values=(value, value))
    assert len(frames.frame_of(topic, repeated)) == 2 * rows


def test_an_obstacle_is_not_a_number_while_absent_and_its_discs_are_behind_its_first_one(second):
    topic = '/scenario/obstacles'
    table = second.table(topic)
    one, other = table.values[0].items
    several = one._replace(others=((2.0, 0.5),))
    crowds = (other,), (several, other), (one, other)
    values = [value._replace(items=items) for value, items in zip(table.values, crowds)]
    frame = frames.frame_of(topic, Columns(table.stamp_ns[:3], table.t_s[:3], values=values))
    assert frame['x_m.1'].tolist() == pytest.approx([np.nan, one.X, one.X], nan_ok=True)
    assert frame['x_m.1.1'].tolist() == pytest.approx([np.nan, one.X + 2.0, np.nan], nan_ok=True)
    assert frame['y_m.1.1'].iloc[1] == one.Y + 0.5
    # in the order of the ids all the same
    columns = [name for name in frame if name.startswith('x_m')]
    assert columns == ['x_m.1', 'x_m.1.1', 'x_m.2']


@pytest.mark.parametrize('topic', frames.FRAMED)
def test_every_topic_has_a_frame_whose_columns_are_described_with_units(second, topic):
    frame, described = second.frame(topic), second.describe(topic)
    assert len(frame) >= len(SENT[topic])
    columns = {name.partition('.')[0] for name in frame}
    assert set(described.index) - {frames.REPORT} <= columns
    if frames.REPORT not in described.index:
        assert columns == set(described.index)
    units = {'yaw_rad': 'rad', 'ax_mps2': 'm/s²', 'load_n': 'N', 'torque_nm': 'N m'}
    for name in units.keys() & set(described.index):
        assert described.loc[name, 'unit'] == units[name]
    assert topic not in TOPICS or described['unit'].all()


def test_every_topic_that_is_decoded_has_a_frame():
    drawn = {name for name in contract.load().topics if name.startswith('/markers/')}
    assert set(frames.FRAMED) == set(contract.load().topics) - drawn


def test_without_pandas_the_extra_is_named(second, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pandas', None)
    with pytest.raises(ImportError, match=r'bags\[frames\]'):
        second.frame('/vehicle/odometry')
    # numpy columns need none
    assert len(second.table('/vehicle/odometry').x_m) == 1000
