"""The baseline through the node graph, and the paper's first experiment from a recorded drive."""

import json
import shutil
import subprocess
import sys

import pytest

from bags.storage import cdr, read
from msgs_yaml import conformance

pytestmark = pytest.mark.usefixtures('dds')


def said_by(program, *arguments):
    """Call `bags` or `experiments` as a user would; return what it printed."""
    result = subprocess.run(
        [sys.executable, '-m', f'{program}.cli', *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_the_baseline_drives_the_double_lane_change_through_its_own_node(recorded_runs):
    found = recorded_runs.comparison['runs']['frenet']
    assert found['completed']
    assert not found['collided']
    assert found['fallbacks'] == found['deadline_misses'] == 0
    bag = read.load(recorded_runs.bag('frenet'))
    controller = json.loads(bag.run_info['parameters'])['controller']
    assert controller['formulation.name'] == 'frenet'
    for name in ('/controller/why', '/controller/prediction', '/controller/command'):
        recording = bag.recordings[name]
        topic = recording.topic
        assert (
            len(recording.payloads) == found['ticks'] + 1
        )  # the state at the end is answered, too
        for payload in recording.payloads:
            message = cdr.decode(payload, topic.schema, topic.type)
            assert conformance.check(name, message) == []


def test_without_collision_avoidance_the_circle_shows_one_distance_in_two_frames(
    recorded_circle, tmp_path
):
    folder = tmp_path / 'circle_20m'  # the command writes beside the bag
    shutil.copytree(recorded_circle.bag('mpcc_no_ca'), folder / 'mpcc_no_ca')
    printed = said_by('bags', 'distances', folder / 'mpcc_no_ca')
    assert 'closed form' in printed
    found = json.loads((folder / 'distances.json').read_text())
    recorded = found['recorded']
    assert recorded['collided']  # nothing keeps it away
    # measured at the driven poses, and by closed form for them
    assert recorded['largest_deviation_from_closed_form_m'] < 1e-9
    # the car kept close to the path, so the table for the path holds for the drive as well
    for side in ('inside', 'outside'):
        closed = found['overestimation_m'][side]
        assert recorded['overestimation_m'][side] == pytest.approx(closed, abs=0.05)
    assert (folder / 'distances.png').stat().st_size > 10_000


def test_a_folder_without_a_bag_has_no_figure(tmp_path):
    missing = subprocess.run(
        [sys.executable, '-m', 'bags.cli', 'distances', tmp_path / 'nothing'],
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert missing.returncode == 1
    assert missing.stderr.startswith('error: ')
    assert missing.stderr.count('\n') == 1
