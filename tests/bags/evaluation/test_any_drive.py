"""Whatever a car did: every metric is a number or nothing, and the comparison gets written."""

import json

import numpy as np
import pytest
from evaluated_drives import compare_drives
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from straight_drive import obstacle

from bags.errors import BagError
from bags.evaluation import metrics
from bags.evaluation.drive import Accelerations, Drive, Inputs, Motion, Obstacle, Ticks

MS, START_NS = 1_000_000, 1_000_000_000
NONE = np.empty(0, dtype=np.int64)


def columns(draw, n, low, high):
    """Return n numbers within limits, some of them perhaps not finite."""
    usual = st.floats(low, high)
    broken = st.one_of(usual, st.sampled_from([np.nan, np.inf, -np.inf]))
    return draw(arrays(float, n, elements=draw(st.sampled_from([usual, broken]))))


def stamps(n, step_ms):
    return START_NS + step_ms * MS * np.arange(n, dtype=np.int64)


@st.composite
def any_drive(draw, facts, scene):
    """Return a drive of at least one state, anywhere within 300 m of a road of 120 m."""
    n = draw(st.integers(1, 60))
    step_ms = draw(st.sampled_from([1, 10, 50]))
    place = (columns(draw, n, -300.0, 300.0) for _ in range(2))
    speeds = (columns(draw, n, -100.0, 100.0) for _ in range(2))
    yaw = columns(draw, n, -np.pi, np.pi)
    m, k, ticks = (draw(st.integers(0, 30)) for _ in range(3))
    near = scene._replace(obstacles=draw(st.sampled_from([(), scene.obstacles])))
    return Drive(
        Motion(stamps(n, step_ms), *place, yaw, *speeds),
        Accelerations(stamps(m, 10), *(columns(draw, m, -100.0, 100.0) for _ in range(2))),
        Inputs(stamps(k, 1), columns(draw, k, -0.6, 0.6), columns(draw, k, -2e4, 1e4)),
        Ticks(
            stamps(ticks, 50),
            columns(draw, ticks, 0.0, 50.0),
            columns(draw, ticks, 0.0, 50.0),
            draw(arrays(bool, ticks)),
            draw(st.sampled_from(['', 'too_slow', 'solver_failed'])),
            stamps(ticks, 50),
            draw(arrays(bool, ticks)),
        ),
        near,
        facts,
    )


@pytest.fixture(scope='module')
def road(make_drive):
    """Return facts and scene: a straight road with two obstacles, one soon gone."""
    drive = make_drive(least_speed=7.0)
    absent = np.where(np.arange(101) < 2, 30.0, np.nan)
    crowd = (obstacle(1, 50.0, 2.0), Obstacle(7, absent, absent, absent, absent, 1.0))
    return drive.facts, drive.scene._replace(obstacles=crowd)


def is_json(found):
    return json.loads(json.dumps(found, allow_nan=False)) == found


@pytest.mark.filterwarnings('error::RuntimeWarning')
def test_metrics_of_any_drive_are_json_and_never_raise(road):
    @settings(max_examples=100)
    @given(any_drive(*road))
    def tried(drive):
        finite = np.all([np.isfinite(column) for column in drive.motion], axis=0)
        if not finite.any():
            with pytest.raises(BagError, match='no state of the car is finite'):
                metrics.compute_metrics(drive)
            return
        result = metrics.compute_metrics(drive)
        assert is_json(result)
        assert result['verdict']
        assert result['lost'] is (result['lost_at_m'] is not None)
        assert result['left_road'] is (result['left_road_at_m'] is not None)
        assert result['collided'] is (result['collided_by'] is not None)
        assert not (result['completed'] and not result['finish_at_m'] <= 120.0)

    tried()


ZERO = np.zeros(40)
ALONG = np.linspace(0.0, 30.0, 40)
LOST = {
    'silent': (1, (ALONG, ZERO, ZERO, ZERO + 20, ZERO)),
    'still': (1, (ZERO, ZERO, ZERO, ZERO, ZERO)),
    'far': (2, (ALONG + 4e3, ALONG - 7e3, ALONG, ZERO + 90, ALONG)),
    'backwards': (40, (ALONG, ZERO, ZERO + np.pi, ZERO - 30, ZERO)),
}


@pytest.mark.slow  # draws every figure
@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('kinds', [('silent',), tuple(LOST)], ids=' '.join)
def test_figures_and_report_of_short_and_lost_drives_are_written(road, kinds, tmp_path):
    facts, scene = road
    drives = {}
    for kind in kinds:
        states, motion = LOST[kind]
        measured = 0 if kind == 'silent' else states
        blank = np.zeros(measured)
        drives[kind] = Drive(
            Motion(stamps(states, 10), *(column[:states] for column in motion)),
            Accelerations(stamps(measured, 10), blank, blank),
            Inputs(stamps(measured, 10), blank, blank),
            Ticks(NONE, np.empty(0), np.empty(0), np.empty(0, dtype=bool)),
            scene if kind == 'backwards' else scene._replace(obstacles=()),
            facts,
        )
    compared = compare_drives(drives, tmp_path)
    assert is_json(json.loads(compared.file.read_text()))
    assert all(path.stat().st_size for path in (*compared.figures, compared.report, compared.sheet))
