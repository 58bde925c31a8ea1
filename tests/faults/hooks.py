"""Where a fault takes hold: what is changed about the processes before they start."""

import subprocess
import sys
from pathlib import Path

from catalogue import HERE, Fault

from experiments.configuration import node_config
from msgs_yaml import share

HARMED, SOUND = '/harmed', '/sound'  # put before the names of topics
HEARS = {  # who is told the harmed messages
    '/scenario/reference': 'controller',
    '/scenario/road_edges': 'controller',
    '/scenario/obstacles': 'controller',
    '/vehicle/odometry': 'controller',
    '/controller/command': 'plant',
    '/clock': 'scenario',
}
MISLED = ('/scenario/reference', '/scenario/road_edges', '/scenario/obstacles')
SPEAKS = {  # whose messages are harmed before anybody hears them
    '/vehicle/actuators': ('plant',),
    '/vehicle/imu': ('plant',),
    '/vehicle/wheels': ('plant',),
    '/controller/prediction': ('controller',),
    '/controller/why': ('controller',),
    # the scenario hears what the plant says; a rule moves both ways, so it is left where it is
    '/diagnostics': ('controller', 'plant', 'recorder'),
}
UNRECORDED = '/unrecorded'  # put before what a misled scenario says
FROM_S = 1.5  # after the first command
FOR_S = 0.5
FROM_TICK = 30
PRIORITY = 20  # of SCHED_FIFO; who is not given it runs without


def remaps(fault: Fault, role: str) -> list[str]:
    """Return the ROS arguments that lead a node past the relay.

    A scenario whose /clock is harmed stamps what it says by it. A recorder ends where time falls
    back (docs/bags.md), so it is not told: its bag is the evidence. For the same
    reason it hears the sound health, by which the refusals of the plant are counted.
    """
    if fault.does != 'relay':
        return []
    heard = [f'{topic}:={HARMED}{topic}' for topic in fault.to if HEARS.get(topic) == role]
    said = [f'{topic}:={SOUND}{topic}' for topic in fault.to if role in SPEAKS.get(topic, ())]
    misled = MISLED if '/clock' in fault.to and role != 'recorder' else ()
    kept = [f'{topic}:={UNRECORDED}{topic}' for topic in misled]
    return [part for rule in heard + said + kept for part in ('-r', rule)]


def relay(fault: Fault, go: Path) -> list[str]:
    """Return the command of the relay; it also tells when the time of other faults has come.

    It begins when the file `go` is there.
    """
    topics = fault.to if fault.does == 'relay' else ()
    source, target = (SOUND, '') if SPEAKS.keys() & set(topics) else ('', HARMED)
    command = [sys.executable, str(HERE / 'relay.py'), source, target, *topics]
    given = {'go': go, 'mode': fault.mode, 'from_s': FROM_S, 'for_s': FOR_S, 'priority': PRIORITY}
    for name, value in (given | (fault.settings if topics else {})).items():
        command.append(f'--{name.replace("_", "-")}={value}')
    return command


def command(fault: Fault, node: node_config.Node) -> list[str]:
    """Return the program of a node."""
    if fault.does == 'fail_ticks' and node.role == 'controller':
        return [sys.executable, str(HERE / 'failing_node.py'), str(FROM_TICK), str(fault.to)]
    return share.node_command(node.package, node.executable)


class MachineClock:
    """The wall clock of the nodes: a page that they all read, and a library that adds it."""

    def __init__(self, folder: Path):
        self.page = folder / 'clock'
        self.page.write_bytes(bytes(8))
        self.library = folder / 'jumping_clock.so'
        source = HERE / 'jumping_clock.c'
        build = ['gcc', '-O2', '-fPIC', '-shared', '-o', str(self.library), str(source)]
        subprocess.run(build, check=True, timeout=60)

    def environment(self) -> dict[str, str]:
        """Return what a node must be started with."""
        return {'LD_PRELOAD': str(self.library), 'JUMPING_CLOCK': str(self.page)}

    def jump(self, seconds: float) -> None:
        """Set the clock."""
        with self.page.open('r+b') as page:
            page.write(round(seconds * 1e9).to_bytes(8, 'little', signed=True))
