"""What the car does when messages, nodes, the road or the solver fail: the faults of the catalogue.

The nodes are real and in this process (`node_ring`): also on the wall clock a fault gives the same
drive each time. What DDS and the system add to it is in test_faults_over_dds.py.
"""

from contextlib import contextmanager

import catalogue
import damage
import numpy as np
import pytest
import yaml
from node_ring import SAMPLED_NS, NodeRing, Relay
from states import STANDSTILL_MPS, Drive

from msgs_yaml import contract
from vehicle_plant.simulator import START_NS

pytestmark = pytest.mark.ros


def is_recorded(fault):
    """Return whether a fault concerns the recorder, which costs a quarter of the time."""
    return fault.target in ('recorder', catalogue.TELEMETRY)


# those that share a drive are neighbours
FAULTS = sorted(
    (fault for fault in catalogue.load() if fault.action not in ('clock_s', 'disk_bytes')),
    key=lambda fault: (fault.mode, is_recorded(fault)),
)
# what is handled alike whatever the topic: in the checks it is done to the state, and to times
ALIKE = ('inf', 'wild', 'empty', 'torn', 'huge', 'frame', 'duplicate', 'reorder')
CHECKED = {'/vehicle/odometry', '/clock', '/vehicle/run_start'}
# rejections of the plant's gate that a correct controller never causes
INVALID = ('not_finite', 'out_of_range', 'too_fast', 'beyond_friction', 'unreadable')
END_M = 500.0  # of the road that faults share, with room to stop
SHARED_M = 650.0
AFTERWARDS_S = 0.3  # driven or stood after a state is to be settled
WITHOUT_PLANT_S = 1.5
SETTINGS = {'plant': {'lockstep_timeout_s': 1.0}}


def shares_a_drive(fault):
    """Return whether a fault leaves a car on a straight road that drives on."""
    is_path = fault.name.startswith('path_')
    return fault.expect == 'OK' and not is_path and fault.action not in ('at_s', 'restart')


def long_road(scenario):
    """Return a scenario on a longer straight road; its obstacle drives beside the car."""
    line = scenario['road']['centre_line'] | {'segments': [{'straight': {'length_m': SHARED_M}}]}
    road = scenario['road'] | {'centre_line': line}
    path = scenario['path'] | {'segments': [{'straight': {'length_m': SHARED_M - 20.0}}]}
    moving = [{'x_m': 40.0, 'y_m': 4.0, 'radius_m': 1.0, 'vx_mps': 15.0, 'vy_mps': 0.0}]
    stop = {'progress_m': END_M + 50.0, 'time_s': 60.0}
    return scenario | {'road': road, 'path': path, 'obstacles': moving, 'stop': stop}


class Rings:
    """The ring in which the last faults were tried, and a new one where that may not go on."""

    def __init__(self, factory):
        self.factory, self.ring = factory, None

    @contextmanager
    def driving(self, fault):
        """Yield a ring whose car drives; after an error the next fault gets another one."""
        try:
            if shares_a_drive(fault):
                yield self.shared(fault)
            else:
                yield self.started(fault, fault.scenario)
        except BaseException:
            self.close()
            raise
        if not shares_a_drive(fault):
            self.close()

    def shared(self, fault):
        ring = self.ring
        is_fit = ring and ring.mode == fault.mode and bool(ring.late) != is_recorded(fault)
        if not (is_fit and ring.stepper.car.state.X < END_M):
            ring = self.started(fault, long_road(fault.scenario))
        ring.spin_until(ring.is_driving)
        return ring

    def started(self, fault, scenario):
        self.close()
        folder = self.factory.mktemp(fault.mode)
        (folder / 'road.yaml').write_text(yaml.safe_dump(scenario))
        self.ring = NodeRing(folder, fault.mode, str(folder / 'road.yaml'), **SETTINGS)
        self.ring.late = () if is_recorded(fault) else ('recorder',)
        self.ring.__enter__()
        self.ring.spin_until(self.ring.is_driving)
        return self.ring

    def close(self):
        ring, self.ring = self.ring, None
        if ring:
            ring.__exit__()


@pytest.fixture(scope='module')
def rings(tmp_path_factory, dds):
    several = Rings(tmp_path_factory)
    yield several
    several.close()


class FailingSolver:
    """A solver whose problem is NaN for a while."""

    def __init__(self, solver, is_failing):
        self.solver, self.is_failing = solver, is_failing

    def solve(self, x0, P, bounds, guess):
        return self.solver.solve(x0, P * np.nan if self.is_failing() else P, bounds, guess)

    def set_time_limit(self, seconds):
        self.solver.set_time_limit(seconds)


def inject(fault, ring, begins_ns):
    """Begin a fault; where it ends before the run does, wait for that, but for one of messages."""

    def is_active():
        return ring.time_ns < begins_ns + fault.lasts_s * 1e9

    if fault.action == 'relay':
        for topic in fault.target:
            rate_hz = contract.load().topics[topic].rate_hz[fault.mode]
            given = {k: v for k, v in fault.settings.items() if k in ('delay_s', 'shift_s')}
            effect = damage.make_effect(fault.settings['do'], rate_hz=rate_hz, **given)
            ring.bus.relays[topic] = Relay(effect, catalogue.SUBSCRIBERS.get(topic, ''), is_active)
    elif fault.action in ('kill', 'restart'):
        ring.kill(fault.target)
        if fault.action == 'restart':
            ring.spin_for(fault.settings['after_s'])
            ring.start(fault.target)
    elif fault.action == 'freeze':
        ring.bus.frozen[fault.target] = []
        if 'for_s' in fault.settings:
            if fault.mode == 'lockstep':
                ring.spin_until(lambda: not is_active())
            else:
                ring.spin_for(fault.lasts_s)
            ring.bus.thaw(fault.target)
    elif fault.action == 'fail_ticks':
        solvers = ring.nodes['controller'].controller.parts.solvers
        last_ns = begins_ns + fault.target * 50_000_000
        solvers.followed = FailingSolver(solvers.followed, lambda: ring.time_ns < last_ns)


def parameter(fault):
    """Return a fault as a parameter; most of the ALIKE are tried each night only."""
    alike = fault.action == 'relay' and fault.settings['do'] in ALIKE
    nightly = alike and not CHECKED.intersection(fault.target)
    return pytest.param(fault, id=fault.name, marks=[pytest.mark.nightly] if nightly else [])


@pytest.mark.parametrize('fault', map(parameter, FAULTS))
def test_a_fault_ends_in_the_expected_state(fault, rings):
    with rings.driving(fault) as ring:
        begins_ns = ring.time_ns
        if fault.action == 'at_s':
            begins_ns = START_NS + round(fault.target * 1e9)
        refused = invalid_commands(ring)
        inject(fault, ring, begins_ns)
        # what a fault of the plant leaves is judged at once, by what the controller does
        plant_lives = fault.expect != 'braking'
        lasts_s = max(fault.within_s, fault.lasts_s if fault.lasts_s < 100.0 else 0.0)
        lasts_s = lasts_s + AFTERWARDS_S if plant_lives else WITHOUT_PLANT_S
        ring.spin_until(
            lambda: (
                ring.has_ended()
                or ring.time_ns >= begins_ns + lasts_s * 1e9
                or (fault.expect == 'stopped' and stands(ring))
            )
        )
        ring.bus.relays.clear()
        drive = Drive()
        drive.speeds = ring.speeds
        drive.reports = [(why.stamp_ns, why.values['rung']) for why in ring.whys]
        final = drive.final_state(begins_ns, plant_lives)
        assert final.state == fault.expect, final
        assert final.settled_s <= fault.within_s, final
        is_damaged = fault.action == 'relay' and '/controller/command' in fault.target
        assert not plant_lives or is_damaged or invalid_commands(ring) == refused


def stands(ring):
    """Return whether the car has stood for AFTERWARDS_S."""
    last = [speed for _, speed in ring.speeds[-round(AFTERWARDS_S * 1e9 / SAMPLED_NS) - 1 :]]
    return max(last) < STANDSTILL_MPS


def invalid_commands(ring):
    rejections = ring.stepper.car.gate.rejections
    return sum(rejections.get(code, 0) for code in INVALID)
