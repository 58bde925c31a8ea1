"""What DDS and the system add to the faults of test_faults.py, with a process for each node.

Each night every fault of a process: killed, frozen, a clock of the machine that jumps, a full disk.
"""

import resource
import signal
import subprocess
import time
from pathlib import Path

import catalogue
import numpy as np
import pytest
import yaml
from node_graph import OF_PROCESSES, Manager, NodeGraph
from states import Drive
from wait_until import wait_until

from bags.storage import read, repair
from experiments.run import processes
from msgs_yaml import decode
from node_runtime import ros

pytestmark = OF_PROCESSES
WHY, ODOMETRY = '/controller/why', '/vehicle/odometry'
DRIVES = 20  # reports of a car that follows its plans
PATIENCE_S = 120.0
WITHOUT_PLANT_S = 1.5
# those that are started again are in tests/ros/test_restarts.py
OTHERS = ('relay', 'at_s', 'fail_ticks', 'restart')
PROCESS = [fault for fault in catalogue.load() if fault.action not in OTHERS]


class Ear:
    """Hears the reports of the controller and the speed of the car."""

    def __init__(self, manager):
        self.reports, self.speeds = [], []  # (stamp, level of fallback), (stamp, m/s)
        ros.subscribe(manager.node, WHY, self.on_why)
        ros.subscribe(manager.node, ODOMETRY, self.on_odometry)
        self.manager = manager

    def on_why(self, message):
        why = decode.why(message)
        self.reports.append((why.stamp_ns, why.values['rung']))

    def on_odometry(self, message):
        state = decode.odometry(message)
        self.speeds.append((state.stamp_ns, np.hypot(state.vx, state.vy)))

    @property
    def now_ns(self):
        return self.reports[-1][0] if self.reports else 0

    def is_driving(self):
        levels = [level for _, level in self.reports[-DRIVES:]]
        return len(levels) == DRIVES and set(levels) == {'solved'}

    def wait(self, condition, text):
        wait_until(
            condition,
            PATIENCE_S,
            text,
            pause=lambda: self.manager.executor.spin_once(timeout_sec=0.02),
        )


class MachineClock:
    """The wall clock of the nodes: an offset in a shared page, added by a preloaded library."""

    def __init__(self, folder: Path):
        self.page, library = folder / 'clock', folder / 'jumping_clock.so'
        self.page.write_bytes(bytes(8))
        source = catalogue.HERE / 'jumping_clock.c'
        command = ['gcc', '-O2', '-fPIC', '-shared', '-o', str(library), str(source)]
        subprocess.run(command, check=True, timeout=240)
        self.environment = {'LD_PRELOAD': str(library), 'JUMPING_CLOCK': str(self.page)}

    def jump(self, seconds: float) -> None:
        """Set the offset of the clock [s]."""
        with self.page.open('r+b') as page:
            page.write(round(seconds * 1e9).to_bytes(8, 'little', signed=True))


def inject(fault, graph, clock):
    """Let a fault happen to the processes of a graph."""
    process = graph.running.get(fault.target if fault.action != 'disk_bytes' else 'recorder')
    if fault.action == 'kill':
        processes.kill(process)
    if fault.action == 'freeze':
        process.popen.send_signal(signal.SIGSTOP)
        if 'for_s' in fault.settings:
            time.sleep(fault.settings['for_s'])
            process.popen.send_signal(signal.SIGCONT)
    if fault.action == 'clock_s':
        clock.jump(fault.target)
    if fault.action == 'disk_bytes':
        limits = (fault.target, fault.target)
        resource.prlimit(process.popen.pid, resource.RLIMIT_FSIZE, limits)


@pytest.mark.nightly
@pytest.mark.flaky(reruns=1)  # a machine that stalls makes nodes late
@pytest.mark.parametrize('fault', PROCESS, ids=lambda fault: fault.name)
def test_a_fault_of_a_process_ends_in_the_expected_state(fault, tmp_path, domain, wall_clock):
    road = tmp_path / 'road.yaml'
    road.write_text(yaml.safe_dump(fault.scenario))
    settings = {'plant': {'lockstep_timeout_s': 10.0}}
    if fault.mode == 'realtime':
        settings = wall_clock.with_priority(**settings)
    clock = MachineClock(tmp_path) if fault.action == 'clock_s' else None
    with (
        wall_clock.own_drive(),
        NodeGraph(tmp_path, domain, fault.mode, str(road), **settings) as graph,
        Manager(domain, fault.mode) as manager,
    ):
        ear = Ear(manager)
        graph.start('recorder')
        graph.environment |= clock.environment if clock else {}
        graph.start('scenario', 'controller', 'plant')
        ear.wait(ear.is_driving, graph.log_tails())
        begins_ns = time.time_ns() if fault.mode == 'realtime' else ear.now_ns
        inject(fault, graph, clock)
        plant = graph.running['plant']
        plant_lives = fault.expect != 'braking'
        if plant_lives:
            ear.wait(lambda: plant.code is not None, graph.log_tails())
        else:
            end_ns = begins_ns + round(WITHOUT_PLANT_S * 1e9)
            ear.wait(lambda: ear.now_ns > end_ns, graph.log_tails())
        for process in graph.running.values():
            if process.code is None:
                process.popen.send_signal(signal.SIGCONT)
    repair.repair_bag(graph.bag)
    bag, drive = read.load(graph.bag), Drive()
    assert bag.damage is None
    drive.speeds, drive.reports = ear.speeds, ear.reports
    if not (fault.action == 'disk_bytes' or fault.target == 'recorder'):
        # what comes in a burst is all in the bag
        table = read.columns(bag, [ODOMETRY])[ODOMETRY]
        drive.speeds = list(zip(table.stamp_ns.tolist(), np.hypot(table.vx_mps, table.vy_mps)))
        drive.reports = [(why.stamp_ns, why.values['rung']) for why in read.values(bag, WHY)]
    if not plant_lives:  # a frozen one drives on when it is woken to end
        drive.reports = [report for report in drive.reports if report[0] <= end_ns]
    final = drive.final_state(begins_ns, plant_lives)
    assert (final.state, final.settled_s <= fault.within_s) == (fault.expect, True), final
