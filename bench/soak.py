"""Does a node graph that runs for an hour grow? "Soak" of docs/faults.md, memory of docs/safety.md.

    .venv/bin/python bench/soak.py                          one hour of simulated time, lockstep
    .venv/bin/python bench/soak.py --mode realtime --minutes 10

The nodes drive on a circle of 500 m radius at 15 m/s, recorded. A drive lasts ten minutes at most;
then all but the controller are started again, as a bag ends where its clock begins anew: an hour is
one life of the controller and six of every other node. From the first command of a drive on, every
node is looked at twice a second, in a short soak more often. After the first fifth of its life, 12
s at least, in which the writers fill their histories, no node may grow: the program fails when it
holds more than 3 MB more memory in the end than then (2 MB in a minute or less; medians over a
tenth of the life, three looks at least), or more files or threads. The recorder may grow by 45 MB
more in a minute or less: until Fast DDS has sent a lost packet of /clock again, it keeps up to
30,000 messages (`bags.storage.message_filing`) of about 1.3 kB; 9 and 27 MB were seen when that
took 3 s, the nodes' profile of Fast DDS makes it 0.1 s. It fails, too, when a drive ends early, and
stops by itself when one takes ten times what it simulates. On the wall clock the nodes run with
real-time priority where the user may give it.

In a drive of 24 s the nodes grew by 0.4 MB at most between the two medians. 2 MB are 120 bytes per
message of 1 kHz in the 17 s between them.
"""

import argparse
import math
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil
import realtime
from tables import markdown

from experiments.configuration import inputs
from experiments.run import domain, processes

LONGEST_DRIVE_MIN = 10.0
LEAST_MIN, MOST_MIN = 0.1, 600.0
ENDED = 'not reached within'  # says the plant when the time is up
SURVIVOR = 'controller'  # lives through all drives
WARM = 0.2  # share of the looks: growth is that from here to the end
FEWEST = 3  # looks that make a median
FILLED_S, LATEST = 12.0, 0.6  # 40 repeats of path and road at 4 Hz, which the writers keep
LOOK_S = 0.5
LOOKS = 1200  # at the pace of the wall clock; lockstep may be ten times as fast
SPARE = 4.0  # looking takes a fifth of a core at most: a faster machine drives and looks faster
MOST_MB = 3.0
SHORT_MIN, SHORT_MB = 1.0, 2.0
KEEPS_BACKLOG, BACKLOG_MB = 'recorder', 45.0  # in a short soak
STARTED = 'started from the actuators'  # says the controller with the first command
END_S = 30.0
SLOWEST = 10.0  # wall time per simulated time, at most
ROAD = Path(__file__).parent / 'scenarios/soak.yaml'


class Look(NamedTuple):
    """What a process holds."""

    memory_mb: float  # resident and anonymous: the pages of libraries come and go with the system
    files: int
    threads: int


def look(pid: int) -> Look | None:
    """Return what a process holds, None when it has just ended."""
    try:
        process = psutil.Process(pid)
        memory = process.memory_info()
        return Look((memory.rss - memory.shared) / 1e6, process.num_fds(), process.num_threads())
    except psutil.Error:
        return None


class Growth(NamedTuple):
    """How much more a node holds at the end of a life."""

    node: str  # its role, and which life of several
    looks: int
    begin: Look
    end: Look
    most_mb: float

    @property
    def grew(self) -> str:
        """What grew beyond what it may, as words."""
        allowed = Look(self.most_mb, 0, 0)
        growth = zip(Look._fields, self.begin, self.end, allowed)
        return ', '.join(name for name, begin, end, most in growth if end - begin > most)


def growth(node: str, looks: list[Look], minutes: float) -> Growth:
    """Return the growth between two tenths of a run of so many minutes, their medians."""
    n, few = len(looks), max(len(looks) // 10, FEWEST)
    warm = int(min(max(WARM, FILLED_S / (60.0 * minutes)), LATEST) * n)
    columns = looks[warm : warm + few], looks[-few:]
    begin, end = (Look(*np.median(np.array(rows), axis=0).tolist()) for rows in columns)
    backlog_mb = BACKLOG_MB if node.split('.')[0] == KEEPS_BACKLOG else 0.0
    return Growth(node, n, begin, end, MOST_MB if minutes > SHORT_MIN else SHORT_MB + backlog_mb)


def soak(mode: str, minutes: float, folder: Path, domain_id: int) -> list[Growth]:
    """Drive for so many minutes of simulated time; raises when a node ends early or none does."""
    # other programs may not stop the car: what is asked is what ten minutes leave behind
    wanted = realtime.FIFO if mode == 'realtime' else {}
    given = {role: {'realtime.priority': priority} for role, priority in wanted.items()}
    nodes = {n.role: n for n in inputs.build_mpcc_nodes(str(ROAD), mode, folder, given)}
    environment = processes.node_environment(domain_id, folder)
    drives = math.ceil(minutes / LONGEST_DRIVE_MIN)
    drive_s = 60.0 * minutes / drives
    look_s = min(LOOK_S, drive_s / LOOKS)
    running: dict[str, processes.Process] = {}
    lives: dict[str, list[Look]] = {}

    def start(role, number, **parameters):
        one_life = drives == 1 or role == SURVIVOR
        life = role if one_life else f'{role}.{number}'
        node = nodes[role]._replace(parameters=nodes[role].parameters | parameters)
        running[role] = processes.start_node(node, folder, environment, log=f'{life}.log')
        return lives.setdefault(life, [])

    try:
        for number in range(1, drives + 1):
            bag = folder / f'bag{number}'
            looks = {
                'recorder': start('recorder', number, out=str(bag)),
                'scenario': start('scenario', number),
                'controller': lives.get(SURVIVOR) or start(SURVIVOR, number),
                'plant': start('plant', number, **{'stop.time_s': drive_s}),
            }
            watch(running, looks, number, look_s, drive_s * SLOWEST + 60.0)
            if ENDED not in running['plant'].log.read_text(errors='replace'):
                raise RuntimeError(processes.exit_report(running['plant']))
            processes.stop([running['scenario'], running['recorder']], END_S)
            shutil.rmtree(bag)
    finally:
        processes.stop(list(running.values()), END_S)
    return [growth(life, found, minutes) for life, found in lives.items()]


def watch(running, looks, drive, look_s, seconds):
    """Look at every node from the first command of a drive, the first is 1, to the plant's end."""
    deadline = time.monotonic() + seconds
    while running['plant'].code is None:
        began = time.thread_time()
        processes.check_running([one for role, one in running.items() if role != 'plant'])
        output = running['controller'].log.read_text(errors='replace')
        for role, process in running.items() if output.count(STARTED) >= drive else ():
            found = look(process.popen.pid)
            looks[role] += [found] if found else []
        if time.monotonic() > deadline:
            raise RuntimeError(f'the drive takes longer than {seconds:.0f} s')
        time.sleep(max(look_s, SPARE * (time.thread_time() - began)))


def main() -> int:
    """Soak and print what grew."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--mode', choices=('lockstep', 'realtime'), default='lockstep')
    parser.add_argument('--minutes', type=float, default=60.0, help='of simulated time')
    given = parser.parse_args()
    if not LEAST_MIN <= given.minutes <= MOST_MIN:
        allowed = f'{LEAST_MIN:g} to {MOST_MIN:g}'
        parser.error(f'--minutes: {given.minutes:g} is not allowed, {allowed} is')
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder, domain.reserved(os.environ) as number:
        found = soak(given.mode, given.minutes, Path(folder), number)
    rows = [
        (own.node, own.looks, *(f'{a:g} -> {b:g}' for a, b in zip(own.begin, own.end)), own.grew)
        for own in found
    ]
    grew = any(own.grew for own in found)
    minutes, text = (time.monotonic() - began) / 60, 'something grew' if grew else 'nothing grew'
    title = f'{given.minutes:g} min {given.mode} in {minutes:.1f} min: {text}'
    print(markdown(title, ('node', 'looks', 'memory [MB]', 'files', 'threads', 'grew'), rows))
    return int(grew)


if __name__ == '__main__':
    sys.exit(main())
