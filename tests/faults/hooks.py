"""Changes of the processes before they start: remapped topics, programs, preloaded libraries."""

import subprocess
import sys
from pathlib import Path

from catalogue import HERE, Fault

from experiments.configuration import node_config
from msgs_yaml import share

DAMAGED, INTACT = '/damaged', '/intact'  # prefixes of topics
SUBSCRIBERS = {  # the node that receives the damaged messages
    '/scenario/reference': 'controller',
    '/scenario/road_edges': 'controller',
    '/scenario/obstacles': 'controller',
    '/vehicle/odometry': 'controller',
    '/vehicle/run_start': 'scenario',
    '/controller/command': 'plant',
    '/clock': 'scenario',
}
MISLED_TOPICS = ('/scenario/reference', '/scenario/road_edges', '/scenario/obstacles')
PUBLISHERS = {  # the nodes whose messages are damaged for all subscribers
    '/vehicle/actuators': ('plant',),
    '/vehicle/imu': ('plant',),
    '/vehicle/wheels': ('plant',),
    '/controller/prediction': ('controller',),
    '/controller/why': ('controller',),
    '/diagnostics': ('controller', 'plant', 'recorder', 'scenario'),
}
UNRECORDED = '/unrecorded'  # prefix of topics of a scenario with a damaged /clock
FROM_S = 1.5  # after the first command
FOR_S = 0.5
FROM_TICK = 30
PRIORITY = 20  # of SCHED_FIFO, where the user may set it


def remaps(fault: Fault, role: str) -> list[str]:
    """Return the ROS arguments that connect a node to the relay.

    A scenario with a damaged /clock stamps its messages by that clock. A recorder ends where time
    goes back (docs/bags.md), so it does not receive them: its bag is the evidence. For the same
    reason it receives the undamaged health, from which the rejections of the plant are counted.
    """
    if fault.action != 'relay':
        return []
    inputs = [
        f'{topic}:={DAMAGED}{topic}' for topic in fault.target if SUBSCRIBERS.get(topic) == role
    ]
    outputs = [
        f'{topic}:={INTACT}{topic}' for topic in fault.target if role in PUBLISHERS.get(topic, ())
    ]
    misled = MISLED_TOPICS if '/clock' in fault.target and role != 'recorder' else ()
    unrecorded = [f'{topic}:={UNRECORDED}{topic}' for topic in misled]
    return [part for rule in inputs + outputs + unrecorded for part in ('-r', rule)]


def relay_command(fault: Fault, go: Path) -> list[str]:
    """Return the command of the relay, which also announces when other faults are due.

    It begins when the file `go` exists.
    """
    topics = fault.target if fault.action == 'relay' else ()
    source, target = (INTACT, '') if PUBLISHERS.keys() & set(topics) else ('', DAMAGED)
    command = [sys.executable, str(HERE / 'relay.py'), source, target, *topics]
    options = {'go': go, 'mode': fault.mode, 'from_s': FROM_S, 'for_s': FOR_S, 'priority': PRIORITY}
    for name, value in (options | (fault.settings if topics else {})).items():
        command.append(f'--{name.replace("_", "-")}={value}')
    return command


def node_command(fault: Fault, node: node_config.Node) -> list[str]:
    """Return the command of a node."""
    if fault.action == 'fail_ticks' and node.role == 'controller':
        return [sys.executable, str(HERE / 'failing_node.py'), str(FROM_TICK), str(fault.target)]
    return share.node_command(node.package, node.executable)


class MachineClock:
    """The wall clock of the nodes: an offset in a shared page, added by a preloaded library."""

    def __init__(self, folder: Path):
        self.page = folder / 'clock'
        self.page.write_bytes(bytes(8))
        self.library = folder / 'jumping_clock.so'
        source = HERE / 'jumping_clock.c'
        command = ['gcc', '-O2', '-fPIC', '-shared', '-o', str(self.library), str(source)]
        subprocess.run(command, check=True, timeout=240)

    def environment(self) -> dict[str, str]:
        """Return the environment variables of the nodes."""
        return {'LD_PRELOAD': str(self.library), 'JUMPING_CLOCK': str(self.page)}

    def jump(self, seconds: float) -> None:
        """Set the offset of the clock [s]."""
        with self.page.open('r+b') as page:
            page.write(round(seconds * 1e9).to_bytes(8, 'little', signed=True))
