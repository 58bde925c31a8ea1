"""One fault in one run: start the nodes, inject the fault in time, stop, keep the bag."""

import contextlib
import resource
import signal
import time
from pathlib import Path
from typing import NamedTuple

import drive_lock
import hooks
import yaml
from catalogue import ROLES, Fault
from stalls import Stalls
from states import BEFORE_NS

from experiments.configuration import inputs, node_config
from experiments.run import processes
from experiments.run.processes import Process
from node_runtime import shutdown

START_NS = 1_000_000_000  # of simulated time
POLL_S = 0.01
NICE = -15  # of the group of processes that is a session
START_S = 120.0  # of wall time, until the fault is due
DRIVE_S = 120.0  # of wall time, from then on
WITHOUT_PLANT_S = 1.5  # recorded after the plant is gone
SETTLE_S = 0.3
END_S = 60.0  # to end after SIGINT; the recorder completes its bag
TIMEOUT_S = 1.0  # without a command, in lockstep


def raise_priority(process: Process) -> None:
    """Give a program a high priority while it loads, where user and kernel allow it."""
    with contextlib.suppress(OSError):
        Path('/proc', str(process.popen.pid), 'autogroup').write_text(str(NICE))


class Evidence(NamedTuple):
    """Logs, bags and exit states of a run."""

    folder: Path  # of the logs
    bag: Path  # of the recorder under test
    witness: Path  # the bag to evaluate
    begins_ns: int | None  # instant of the fault; None when the run never reached it
    plant: int | None  # exit code of the plant, None when the suite ended it
    hung: tuple[str, ...]  # steps and processes that did not end
    ended: tuple[str, ...]  # nodes that ended unexpectedly
    stall_s: float  # longest stall of the machine around the fault


class FaultRun:
    """The processes of one run, by role."""

    def __init__(self, fault: Fault, folder: Path, domain: int):
        self.fault, self.folder = fault, folder
        folder.mkdir(parents=True)
        scenario = folder / 'road.yaml'
        scenario.write_text(yaml.safe_dump(fault.scenario))
        facts = inputs.load_facts(str(scenario))
        self.bag = self.witness = folder / node_config.BAG_FOLDER
        self.go = folder / 'go'
        given = {'realtime.priority': hooks.PRIORITY} if fault.mode == 'realtime' else {}
        self.needs_witness = fault.action == 'disk_bytes' or fault.target == 'recorder'
        if self.needs_witness:  # its bag is not reliable: a second recorder records too
            self.witness = folder / 'witness'
            given['recorders'] = 2
        overrides = {role: dict(given) for role in ROLES}
        overrides['recorder'].pop('recorders', None)
        overrides['controller']['recorders'] = given.get('recorders', 1) + 1  # and the relay
        overrides['plant']['lockstep_timeout_s'] = TIMEOUT_S
        found = node_config.build_mpcc_nodes(facts, fault.mode, folder, overrides)
        self.nodes = {node.role: node for node in found}
        # independent of the shell
        here = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        self.environment = processes.node_environment(domain, folder) | here
        self.clock = hooks.MachineClock(folder) if fault.action == 'clock_s' else None
        self.running: dict[str, Process] = {}
        self.expected_exits: list[Process] = []  # processes that the fault ends
        self.begins_ns = None

    def start(self):
        """Start every node but the plant, the recorders first.

        A waiting plant would send states at 1 kHz with real-time priority.
        """
        self.start_node('recorder')
        if self.needs_witness:
            node = self.nodes['recorder']
            given = node.parameters | {'out': str(self.witness)}
            self.nodes['witness'] = node._replace(role='witness', parameters=given)
            self.start_node('witness')
        for role in ('scenario', 'controller'):
            self.start_node(role)
        self.start_relay()

    def start_relay(self):
        """Start the relay; every drive waits for it, and it waits for `release_relay`."""
        log, command = self.folder / 'relay.log', hooks.relay_command(self.fault, self.go)
        relay = processes.start('relay', command, log, self.environment)
        self.running['relay'] = relay
        raise_priority(relay)

    def release_relay(self):
        """Allow the drive to begin as soon as every node is ready."""
        self.go.touch()

    def start_node(self, role):
        """Start one node; a restart gets a new log."""
        node, environment = self.nodes[role], self.environment
        if self.clock and role not in ('recorder', 'witness'):
            environment = environment | self.clock.environment()
        self.running[role] = processes.start_node(
            node,
            self.folder,
            environment,
            log=f'{role}{len(self.expected_exits) or ""}.log',
            program=hooks.node_command(self.fault, node),
            extra_arguments=hooks.remaps(self.fault, role),
        )
        raise_priority(self.running[role])

    def wait(self, seconds, until):
        """Wait until `until()` is true, at most `seconds`; return whether it became true."""
        end = time.monotonic() + seconds
        while not until():
            if time.monotonic() > end:
                return False
            time.sleep(POLL_S)
        return True

    def fault_has_begun(self):
        """Return whether the fault is due, and store its instant."""
        names = ('controller', 'relay') if self.fault.action == 'fail_ticks' else ('relay',)
        for name in names:
            for line in self.running[name].log.read_text(errors='replace').splitlines():
                if line.startswith('begins '):
                    self.begins_ns = int(line.split()[1])
                    return True
        return False

    def has_ended(self):
        """Return whether a process has ended."""
        return any(process.code is not None for process in self.running.values())

    def has_plant_ended(self):
        """Return whether the plant has ended."""
        return self.running['plant'].code is not None

    def inject(self):
        """Inject the faults that the relay does not inject."""
        fault = self.fault
        victim = self.running.get(fault.target) if isinstance(fault.target, str) else None
        if fault.mode == 'realtime' and fault.action not in ('relay', 'fail_ticks'):
            self.begins_ns = time.time_ns()
        if fault.action in ('kill', 'restart'):
            processes.kill(victim)
            self.expected_exits.append(victim)
        if fault.action == 'restart':
            time.sleep(fault.settings['after_s'])
            self.start_node(fault.target)
        if fault.action == 'freeze':
            victim.popen.send_signal(signal.SIGSTOP)
            if 'for_s' in fault.settings:
                time.sleep(fault.settings['for_s'])
                victim.popen.send_signal(signal.SIGCONT)
            else:
                self.expected_exits.append(victim)
        if fault.action == 'clock_s':
            self.clock.jump(fault.target)
        if fault.action == 'disk_bytes':
            pid = self.running['recorder'].popen.pid
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (fault.target, fault.target))
            self.expected_exits.append(self.running['recorder'])
        if fault.action == 'at_s':
            self.begins_ns = START_NS + round(fault.target * 1e9)

    def stop(self):
        """End every process; return the names of those that had to be killed."""
        frozen = [
            p for p in self.expected_exits if p.code is None and self.fault.action == 'freeze'
        ]
        for process in frozen:
            processes.kill(process)
        processes.stop(list(self.running.values()), END_S)
        ended = [process for process in self.running.values() if process not in self.expected_exits]
        return [process.name for process in ended if was_forced_to_end(process)]


def was_forced_to_end(process: Process) -> bool:
    """Return whether a process was killed by the suite or by its own shutdown timer."""
    log = process.log.read_text(errors='replace')
    return process.code == -signal.SIGKILL or shutdown.TRACEBACK_START in log


def drive_through_fault(fault: Fault, run: FaultRun) -> list[str]:
    """Start the nodes, drive, inject the fault, wait for the end; return what timed out."""
    run.start()
    with drive_lock.hold(fault.mode):
        run.start_node('plant')
        run.release_relay()
        ready = run.wait(START_S, lambda: run.fault_has_begun() or run.has_ended())
        if run.begins_ns is None and fault.action != 'at_s':
            return [] if ready else ['start']
        run.inject()
        never_ends = fault.action in ('kill', 'freeze') and fault.target == 'plant'
        if never_ends and 'for_s' not in fault.settings:
            time.sleep(WITHOUT_PLANT_S)
        elif not run.wait(DRIVE_S, run.has_plant_ended):
            return ['drive']
    return []


def run_fault(fault: Fault, folder: Path, domain: int) -> Evidence:
    """Run one fault in a new folder; no process is left running."""
    run, stalls, hung, ended = FaultRun(fault, folder, domain), Stalls(), [], []
    try:
        with stalls:
            hung += drive_through_fault(fault, run)
        time.sleep(SETTLE_S)
        for role, process in run.running.items():
            if role != 'plant' and process.code is not None and process not in run.expected_exits:
                ended.append(role)
        code = run.running['plant'].code
    finally:
        hung += run.stop()
    # a run that never reached its fault may have been stalled at any time
    since_ns = 0 if run.begins_ns is None else run.begins_ns - BEFORE_NS
    return Evidence(
        folder=folder,
        bag=run.bag,
        witness=run.witness,
        begins_ns=run.begins_ns,
        plant=code,
        hung=tuple(hung),
        ended=tuple(ended),
        stall_s=stalls.lost_s(since_ns),
    )
