"""A spinning car is recorded, evaluated and reported by the node graph; no program fails."""

import json
import subprocess
import sys

import pytest
import yaml

from bags.storage import cdr, read
from msgs_yaml import conformance
from scenario_publisher import scenario

pytestmark = [pytest.mark.usefixtures('dds'), pytest.mark.timeout(1000)]
SECONDS = 900  # of wall time: the machine may be busy


def test_a_car_that_spins_is_a_result(tmp_path):
    document = yaml.safe_load(scenario.load('double_lane_change').text)
    document |= {'speed': {'constant_mps': 38.0}, 'name': 'too_fast'}
    file = tmp_path / 'too_fast.yaml'
    file.write_text(yaml.safe_dump(document))
    # the controller believes that the road is dry
    arguments = ('run', file, '--out', tmp_path, '--set', 'plant.friction=0.2')
    result = subprocess.run(
        [sys.executable, '-m', 'experiments.cli', *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    folder = tmp_path / 'too_fast'
    assert (folder / 'comparison.json').is_file(), result.stdout + result.stderr
    found = json.loads((folder / 'comparison.json').read_text())
    run = found['runs']['mpcc']
    assert (run['lost'], run['lost_how']) == (True, 'spun')
    assert f'spun at {run["lost_at_m"]:.0f} m' in run['verdict']
    assert f'mpcc: {run["verdict"]}' in result.stdout
    assert result.returncode == (0 if run['completed'] else 1)
    bag = read.load(folder / 'mpcc')
    # backwards, and every message is within the contract
    assert read.columns(bag)['/vehicle/odometry'].vx_mps.min() < -20.0
    assert 'invalid_messages' not in found
    for name in ('/vehicle/odometry', '/vehicle/wheels', '/vehicle/imu', '/controller/why'):
        topic, payloads = bag.recordings[name].topic, bag.recordings[name].payloads
        for payload in payloads[::10]:
            assert not conformance.check(name, cdr.decode(payload, topic.schema, topic.type))
