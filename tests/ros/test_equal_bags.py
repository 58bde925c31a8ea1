"""Lockstep runs give the same bags, however long their nodes keep each other waiting."""

import os
from pathlib import Path

import equal_bags
import pytest
from node_graph import ROLES, NodeGraph

from bags.storage import read

RUNS = int(os.environ.get('EQUAL_RUNS', '3'))
SHORT = {'stop.x_m': 8.0, 'stop.armed_after_m': 1.0}  # half a second of driving


def drive(folder: Path, domain: int, first: str, states: int) -> read.Bag:
    """Start one node only when the others have waited for it so long, or all at once."""
    folder.mkdir()
    with NodeGraph(folder, domain, plant=SHORT) as graph:
        for role in ROLES:
            if role != first:
                graph.start(role)
        if first:
            graph.wait_for_messages('/vehicle/odometry', lambda found: len(found) >= states)
            graph.start(first)
        assert graph.wait('plant') == 0, graph.log('plant')
        return graph.stop_recording()


def test_a_state_that_is_sent_again_until_its_first_answer_is_recorded_once(tmp_path, domain):
    """The plant does not wait for the scenario, but the controller does."""
    expected = equal_bags.contents(drive(tmp_path / 'at_once', domain, '', 0))
    waited = drive(tmp_path / 'waited', domain, 'scenario', 3)
    assert equal_bags.differences(expected, equal_bags.contents(waited)) == []


@pytest.mark.slow
def test_runs_beside_three_busy_programs_have_equal_bags(tmp_path, dds, monkeypatch):
    monkeypatch.delenv('ROS_DOMAIN_ID', raising=False)  # each run takes a free one
    settings = [f'plant.{name}={value}' for name, value in SHORT.items()]
    with equal_bags.busy(3):
        first, *others = (
            equal_bags.contents(equal_bags.drive(tmp_path / str(k), 'straight', 'mpcc', settings))
            for k in range(RUNS)
        )
    for other in others:
        assert equal_bags.differences(first, other) == []
