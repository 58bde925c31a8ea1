"""Does a ring that drives for an hour keep growing? Memory, open files, threads, shared memory.

    .venv/bin/python bench/soak.py                          one hour of simulated time, lockstep
    .venv/bin/python bench/soak.py --mode realtime --minutes 10

The nodes drive round and round on a circle of 500 m radius, recorded, at 15 m/s, or as fast as 23
km last that long; after every ten minutes the bag goes on in another file. From the first command
on, every node is looked at twice a second, in a short soak more often. After the first fifth
nothing may grow: the program fails when a node holds more than 3 MB more memory in the end than
then (2 MB in a minute or less; medians over a tenth of the run), or more files, threads or DDS
segments. It fails, too, when the drive ends early, and stops by itself when it takes ten times what
it simulates.

In the first minute the buffers of the recorder still fill: it grew by 0.5 to 1.4 MB between the two
medians of 24 s, the other nodes by 0.2 MB at most. 2 MB are 120 bytes per message of 1 kHz in the
17 s between them. The controller holds 5 MB more while it solves, in up to a quarter of the looks:
a tenth of a run must be a dozen looks or more, for its median not to see that.
"""

import argparse
import json
import math
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from bags import closed_loop
from bags.experiments import domain, launch, processes

FARTHEST_M, FASTEST_MPS = 23000.0, 15.0  # a path has 5,000 points, 5 m apart, at most
LONGEST_ARC_M, MARGIN_M = 9900.0, 100.0
NEVER_M = 1e5
SLOW_MPS = 5.0  # it may drive as slowly as that
LONGEST_MIN = 60.0  # at less than 6.4 m/s a car that once brakes would not drive on
ENDED = 'not reached within'  # says the plant when the time is up
SPLIT_S = 600.0  # an index of what is in a file grows with it
WARM, END = 0.2, 0.9  # shares of the looks: growth is that from the one to the other
LOOK_S = 0.5
LOOKS = 400  # at least, at the pace of the wall clock; lockstep is up to three times as fast
MOST_MB = 3.0
SHORT_MIN, SHORT_MB = 1.0, 2.0
STARTED = 'started from the actuators'  # says the controller with the first command
SLOWEST = 10.0  # wall time per simulated time, at most
ROAD = """
schema: 1
name: soak
description: A circle of 500 m radius, driven for so long.
road:
  centre_line:
    start: {{x_m: 0.0, y_m: 0.0, yaw_rad: 0.0}}
    segments: {road}
  edges: {{left: {{offset_m: 4.0}}, right: {{offset_m: -4.0}}}}
path:
  start: {{x_m: 0.0, y_m: 0.0, yaw_rad: 0.0}}
  segments: {path}
speed: {{constant_mps: {speed_mps:.3f}}}
friction: 1.0
start: {{progress_m: 0.0}}
stop: {{progress_m: 9000.0, time_s: 600.0}}
obstacles: []
sampling: {{path_m: 5.0, edges_m: 5.0}}
"""


class Look(NamedTuple):
    """What a process holds."""

    memory_mb: float
    files: int
    threads: int
    segments: int  # of shared memory, of DDS


def look(pid: int) -> Look | None:
    """Return what a process holds, None when it has just ended."""
    folder = Path('/proc', str(pid))
    try:
        status = dict(line.split(':', 1) for line in (folder / 'status').read_text().splitlines())
        maps = (folder / 'maps').read_text().splitlines()
        files = list((folder / 'fd').iterdir())
    except OSError:
        return None
    if 'VmRSS' not in status:
        return None
    return Look(
        memory_mb=int(status['VmRSS'].split()[0]) / 1e3,
        files=len(files),
        threads=int(status['Threads']),
        segments=len({line.split()[-1] for line in maps if '/dev/shm/fastrtps' in line}),
    )


class Growth(NamedTuple):
    """How much more a node holds at the end."""

    node: str
    looks: int
    begin: Look
    end: Look
    most_mb: float = MOST_MB

    @property
    def grew(self) -> list[str]:
        """What grew beyond what it may."""
        found = [n for n in Look._fields[1:] if getattr(self.end, n) > getattr(self.begin, n)]
        return found + ['memory_mb'] * (self.end.memory_mb - self.begin.memory_mb > self.most_mb)


def growth(node: str, looks: list[Look], minutes: float) -> Growth:
    """Return the growth between two tenths of a run of so many minutes, their medians."""
    n, tenth = len(looks), max(len(looks) // 10, 1)
    columns = [looks[k : k + tenth] for k in (int(WARM * n), int(END * n))]
    begin, end = (Look(*np.median(np.array(rows), axis=0).tolist()) for rows in columns)
    return Growth(node, n, begin, end, SHORT_MB if minutes <= SHORT_MIN else MOST_MB)


def scenario(minutes: float) -> str:
    """Return a scenario whose path is as long as the drive, and a little more."""
    speed_mps = min(FASTEST_MPS, FARTHEST_M / (60.0 * minutes))
    length_m = max(speed_mps * 60.0 * minutes, LONGEST_ARC_M) + MARGIN_M

    def arcs(length_m):
        count = math.ceil(length_m / LONGEST_ARC_M)
        return json.dumps([{'arc': {'length_m': length_m / count, 'curvature_1pm': 0.002}}] * count)

    return ROAD.format(speed_mps=speed_mps, path=arcs(length_m), road=arcs(length_m + MARGIN_M))


def soak(mode: str, minutes: float, folder: Path, number: int) -> list[Growth]:
    """Drive for so many minutes of simulated time; raises when a node ends early or none does."""
    road = folder / 'road.yaml'
    road.write_text(scenario(minutes))
    facts = closed_loop.scenario_facts(str(road))
    nodes = launch.plain_ring(facts, mode, folder, {})
    environment = launch.environment(number, folder)
    running: dict[str, processes.Process] = {}
    looks: dict[str, list[Look]] = {node.role: [] for node in nodes}

    def start(node, **parameters):
        node = node._replace(parameters=node.parameters | parameters)
        running[node.role] = launch.start(node, folder, environment)

    end = {'stop.time_s': 60.0 * minutes, 'stop.armed_after_m': NEVER_M}  # not at the line
    slow = {'limits.least_speed_mps': SLOW_MPS}
    more = {'recorder': {'split_s': SPLIT_S}, 'controller': slow, 'plant': end}
    look_s = min(LOOK_S, 60.0 * minutes / LOOKS)
    try:
        for node in nodes:
            start(node, **more.get(node.role, {}))
        watch(running, looks, look_s, 60.0 * minutes * SLOWEST + 60.0)
        if ENDED not in running['plant'].log.read_text(errors='replace'):
            raise RuntimeError(processes.obituary(running['plant']))
    finally:
        processes.stop(list(running.values()), 30.0)
    return [growth(role, found, minutes) for role, found in looks.items()]


def watch(running, looks, look_s, seconds):
    """Look at every node from the first command until the plant ends."""
    deadline = time.monotonic() + seconds
    while running['plant'].code is None:
        processes.check([one for role, one in running.items() if role != 'plant'])
        drives = STARTED in running['controller'].log.read_text(errors='replace')
        for role, process in running.items() if drives else ():
            found = look(process.popen.pid)
            looks[role] += [found] if found else []
        if time.monotonic() > deadline:
            raise RuntimeError(f'the drive takes longer than {seconds:.0f} s')
        time.sleep(look_s)


def row(found: Growth) -> str:
    """Return one line of the table."""
    pairs = (f'{a:g} -> {b:g}' for a, b in zip(found.begin, found.end))
    told = f'GREW: {", ".join(found.grew)}' if found.grew else ''
    return f'{found.node:<11} {found.looks:>6} ' + ' '.join(f'{p:>18}' for p in pairs) + f' {told}'


def main() -> int:
    """Soak and print what grew."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--mode', choices=('lockstep', 'realtime'), default='lockstep')
    parser.add_argument('--minutes', type=float, default=60.0, help='of simulated time')
    given = parser.parse_args()
    if not 0.0 < given.minutes <= LONGEST_MIN:
        parser.error(f'--minutes: {given.minutes:g} is not above 0 and at most {LONGEST_MIN:g}')
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder, domain.reserved(os.environ) as number:
        found = soak(given.mode, given.minutes, Path(folder), number)
    heads = ('memory [MB]', 'files', 'threads', 'DDS segments')
    print(f'{"node":<11} {"looks":>6} ' + ' '.join(f'{head:>18}' for head in heads))
    print('\n'.join(map(row, found)))
    grew = any(one.grew for one in found)
    minutes = (time.monotonic() - began) / 60
    print(f'{given.minutes:g} min {given.mode} in {minutes:.1f} min: ', end='')
    print('something grew' if grew else 'nothing grew')
    return int(grew)


if __name__ == '__main__':
    sys.exit(main())
