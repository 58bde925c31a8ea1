"""The process that damages messages and announces when a fault is due."""

import time

import catalogue
import pytest
from fault_run import FaultRun

from experiments.run import domain

pytestmark = pytest.mark.ros
PATIENCE_S = 40.0


def test_no_drive_begins_before_the_relay_subscribes_to_the_controller(tmp_path):
    """Otherwise the fault of a fast drive in lockstep would be due before the relay runs."""
    (fault,) = [f for f in catalogue.load() if f.name == 'controller_killed_lockstep']
    with domain.reserved({}) as number:
        assert_begins_with_the_relay(FaultRun(fault, tmp_path / 'run', number))


def assert_begins_with_the_relay(run):
    def log(role):
        return run.running[role].log.read_text()

    try:
        for role in ('recorder', 'scenario', 'controller', 'plant'):
            run.start_node(role)
        missing = '2 subscriptions to /controller/why (has 1)'
        other_inputs = ('state', 'path', 'road', 'actuators')

        def waits_for_the_relay_only():
            last = log('controller').splitlines()[-1:]
            return last and missing in last[0] and not any(name in last[0] for name in other_inputs)

        assert run.wait(PATIENCE_S, waits_for_the_relay_only), log('controller')
        time.sleep(1.0)
        assert 'started from the actuators' not in log('controller')
        run.start_relay()
        run.release_relay()
        assert run.wait(PATIENCE_S, run.fault_has_begun), log('controller')
        assert 'started from the actuators' in log('controller')
    finally:
        run.stop()
