"""One fault on one ring: start the nodes, do the fault in time, stop, keep the bag."""

import contextlib
import resource
import signal
import time
from pathlib import Path
from typing import NamedTuple

import hooks
import slot
import yaml
from catalogue import ROLES, Fault
from stalls import Stalls
from states import BEFORE_NS

from experiments.configuration import inputs, node_config
from experiments.run import processes
from experiments.run.processes import Process
from node_runtime import shutdown

START_NS = 1_000_000_000  # of simulated time
LOOK_S = 0.01
NICE = -15  # of the group of processes that is a session
START_S = 40.0  # of wall time, until the fault's time has come
DRIVE_S = 40.0  # of wall time, from then on
ALONE_S = 1.5  # how long the others are watched when the plant is gone
SETTLE_S = 0.3
END_S = 12.0  # to end after SIGINT; the recorder completes its bag
TIMEOUT_S = 1.0  # without a command, in lockstep


def prefer(process: Process) -> None:
    """Let a program load before others get their turn, where user and kernel can."""
    with contextlib.suppress(OSError):
        Path('/proc', str(process.popen.pid), 'autogroup').write_text(str(NICE))


class Evidence(NamedTuple):
    """What a fault left behind."""

    folder: Path  # of the logs
    bag: Path  # of the ring's recorder
    witness: Path  # the bag to judge by
    begins_ns: int | None  # the fault; None when its time never came
    plant: int | None  # exit code of the plant, None when it had to be ended
    hung: tuple[str, ...]  # what did not come to an end
    ended: tuple[str, ...]  # nodes that ended by themselves and should not have
    stall_s: float  # time for which the machine gave a thread no turn, around the fault


class Ring:
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
        self.doubted = fault.does == 'disk_bytes' or fault.to == 'recorder'
        if self.doubted:  # its bag is no evidence: a second recorder watches
            self.witness = folder / 'witness'
            given['recorders'] = 2
        overrides = {role: dict(given) for role in ROLES}
        overrides['recorder'].pop('recorders', None)
        overrides['controller']['recorders'] = given.get('recorders', 1) + 1  # and the relay
        overrides['plant']['lockstep_timeout_s'] = TIMEOUT_S
        found = node_config.build_mpcc_nodes(facts, fault.mode, folder, overrides)
        self.nodes = {node.role: node for node in found}
        # whatever the shell says
        here = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
        self.environment = processes.node_environment(domain, folder) | here
        self.clock = hooks.MachineClock(folder) if fault.does == 'clock_s' else None
        self.running: dict[str, Process] = {}
        self.spared: list[Process] = []  # that were killed on purpose
        self.begins_ns = None

    def start(self):
        """Start every node but the plant, the recorders first.

        A plant that waits for its drive sends states at 1 kHz with the priority of one that drives.
        """
        self.begin('recorder')
        if self.doubted:
            node = self.nodes['recorder']
            given = node.parameters | {'out': str(self.witness)}
            self.nodes['witness'] = node._replace(role='witness', parameters=given)
            self.begin('witness')
        for role in ('scenario', 'controller'):
            self.begin(role)
        self.begin_relay()

    def begin_relay(self):
        """Start the relay, which every drive waits for; it waits to be let go."""
        log, command = self.folder / 'relay.log', hooks.relay(self.fault, self.go)
        relay = processes.start('relay', command, log, self.environment)
        self.running['relay'] = relay
        prefer(relay)

    def let_go(self):
        """Let the drive begin as soon as every node is ready."""
        self.go.touch()

    def begin(self, role):
        """Start one node; a second time under another log."""
        node, environment = self.nodes[role], self.environment
        if self.clock and role not in ('recorder', 'witness'):
            environment = environment | self.clock.environment()
        self.running[role] = processes.start_node(
            node,
            self.folder,
            environment,
            log=f'{role}{len(self.spared) or ""}.log',
            program=hooks.command(self.fault, node),
            extra_arguments=hooks.remaps(self.fault, role),
        )
        prefer(self.running[role])

    def wait(self, seconds, until):
        """Wait until something is so; return whether it came to be."""
        end = time.monotonic() + seconds
        while not until():
            if time.monotonic() > end:
                return False
            time.sleep(LOOK_S)
        return True

    def has_begun(self):
        """Tell whether the time of the fault has come, and note it."""
        names = ('controller', 'relay') if self.fault.does == 'fail_ticks' else ('relay',)
        for name in names:
            for line in self.running[name].log.read_text(errors='replace').splitlines():
                if line.startswith('begins '):
                    self.begins_ns = int(line.split()[1])
                    return True
        return False

    def has_ended(self):
        """Tell whether a node has ended before the time of the fault."""
        return any(process.code is not None for process in self.running.values())

    def is_over(self):
        """Tell whether the plant of the run has ended."""
        return self.running['plant'].code is not None

    def harm(self):
        """Do what the relay does not do."""
        fault = self.fault
        victim = self.running.get(fault.to) if isinstance(fault.to, str) else None
        if fault.mode == 'realtime' and fault.does not in ('relay', 'fail_ticks'):
            self.begins_ns = time.time_ns()
        if fault.does in ('kill', 'restart'):
            processes.kill(victim)
            self.spared.append(victim)
        if fault.does == 'restart':
            time.sleep(fault.settings['after_s'])
            self.begin(fault.to)
        if fault.does == 'freeze':
            victim.popen.send_signal(signal.SIGSTOP)
            if 'for_s' in fault.settings:
                time.sleep(fault.settings['for_s'])
                victim.popen.send_signal(signal.SIGCONT)
            else:
                self.spared.append(victim)
        if fault.does == 'clock_s':
            self.clock.jump(fault.to)
        if fault.does == 'disk_bytes':
            pid = self.running['recorder'].popen.pid
            resource.prlimit(pid, resource.RLIMIT_FSIZE, (fault.to, fault.to))
            self.spared.append(self.running['recorder'])
        if fault.does == 'at_s':
            self.begins_ns = START_NS + round(fault.to * 1e9)

    def stop(self):
        """End every process; return the names of those that did not end by themselves."""
        frozen = [p for p in self.spared if p.code is None and self.fault.does == 'freeze']
        for process in frozen:
            processes.kill(process)
        processes.stop(list(self.running.values()), END_S)
        ended = [process for process in self.running.values() if process not in self.spared]
        return [process.name for process in ended if was_held(process)]


def was_held(process: Process) -> bool:
    """Tell whether a process had to be ended, by the suite or by its own timer."""
    said = process.log.read_text(errors='replace')
    return process.code == -signal.SIGKILL or shutdown.TRACEBACK_START in said


def undergo(fault: Fault, ring: Ring) -> list[str]:
    """Start a ring and see its fault through; return what took too long."""
    ring.start()
    with slot.drive(fault.mode):
        ring.begin('plant')
        ring.let_go()
        came = ring.wait(START_S, lambda: ring.has_begun() or ring.has_ended())
        if ring.begins_ns is None and fault.does != 'at_s':
            return [] if came else ['start']
        ring.harm()
        never_ends = fault.does in ('kill', 'freeze') and fault.to == 'plant'
        if never_ends and 'for_s' not in fault.settings:
            time.sleep(ALONE_S)
        elif not ring.wait(DRIVE_S, ring.is_over):
            return ['drive']
    return []


def drive(fault: Fault, folder: Path, domain: int) -> Evidence:
    """Run one fault in a new folder; leaves no process behind, whatever happens."""
    ring, stalls, hung, ended = Ring(fault, folder, domain), Stalls(), [], []
    try:
        with stalls:
            hung += undergo(fault, ring)
        time.sleep(SETTLE_S)
        for role, process in ring.running.items():
            if role != 'plant' and process.code is not None and process not in ring.spared:
                ended.append(role)
        code = ring.running['plant'].code
    finally:
        hung += ring.stop()
    # a run that never came to its fault may have been held up at any time
    since_ns = 0 if ring.begins_ns is None else ring.begins_ns - BEFORE_NS
    return Evidence(
        folder=folder,
        bag=ring.bag,
        witness=ring.witness,
        begins_ns=ring.begins_ns,
        plant=code,
        hung=tuple(hung),
        ended=tuple(ended),
        stall_s=stalls.lost_s(since_ns),
    )
