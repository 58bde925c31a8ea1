"""The process that harms messages, and tells when the time of a fault has come."""

import time

import catalogue
import pytest
from ring import Ring

from experiments.run import domain

pytestmark = pytest.mark.ros
PATIENCE_S = 40.0


def test_no_drive_begins_before_the_relay_hears_the_controller(tmp_path):
    """A late one would miss the time of its fault: a drive in lockstep may take a second."""
    (fault,) = [one for one in catalogue.load() if one.name == 'controller_killed_lockstep']
    with domain.reserved({}) as number:
        see_it_begin(Ring(fault, tmp_path / 'ring', number))


def see_it_begin(ring):
    def said(role):
        return ring.running[role].log.read_text()

    try:
        for role in ('recorder', 'scenario', 'controller', 'plant'):
            ring.begin(role)
        missing = '2 subscriptions to /controller/why (has 1)'
        others = ('state', 'path', 'road', 'actuators')

        def waits_for_the_relay_only():
            last = said('controller').splitlines()[-1:]
            return last and missing in last[0] and not any(one in last[0] for one in others)

        assert ring.wait(PATIENCE_S, waits_for_the_relay_only), said('controller')
        time.sleep(1.0)
        assert 'started from the actuators' not in said('controller')
        ring.begin_relay()
        ring.let_go()
        assert ring.wait(PATIENCE_S, ring.has_begun), said('controller')
        assert 'started from the actuators' in said('controller')
    finally:
        ring.stop()
