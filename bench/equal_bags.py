"""Do lockstep runs give equal bags on a busy machine? What docs/bags.md says of it.

    .venv/bin/python bench/equal_bags.py [--runs 100]

Drives the same run again and again through the node graph, beside three programs that compute all
the time, and compares each bag with the first:
on every topic the same messages in the same order, bit for bit. Times of the wall clock are exempt:
computing times in /controller/why, where /diagnostics of one node stand among those of others, and
logs and transitions of nodes. Prints what differs; exit code 1 when a bag differs.
"""

import argparse
import contextlib
import multiprocessing
import os
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from rich.console import Console

from bags.storage import cdr, read
from experiments.run import run_and_compare
from msgs_yaml.contract import DERIVED_TYPES

EXEMPT = re.compile(r'time\..*|candidates\..*\.cpu_ms')  # values of the wall clock
BUSY = 3  # programs
HEALTH = 'diagnostic_msgs/msg/DiagnosticArray'
ANY_ORDER = '/diagnostics'  # several publishers: only each one's order is that of simulated time


@contextlib.contextmanager
def busy() -> Iterator[None]:
    """Keep BUSY processors busy, or share fewer with whatever else runs."""
    programs = [multiprocessing.Process(target=_compute, daemon=True) for _ in range(BUSY)]
    for program in programs:
        program.start()
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.join()


def _compute():
    parent = os.getppid()
    while os.getppid() == parent:
        sum(range(100_000))


def drive(out: Path, scenario: str = 'straight', settings: Sequence[str] = ()) -> read.Bag:
    """Drive once in lockstep; return the bag. Raises RuntimeError for a run without one."""
    request = run_and_compare.Request(scenario, ['mpcc'], 'lockstep', out, settings, 900.0)
    _, [outcome] = run_and_compare.run_controllers(request, Console(quiet=True))
    if outcome.bag is None:
        raise RuntimeError(outcome.message)
    return read.load(outcome.bag)


def contents(bag: read.Bag) -> dict[str, list[tuple]]:
    """Return what is recorded of each topic, without the times of the wall clock."""
    recorded = {}
    for name, (topic, *_, payloads) in bag.recordings.items():
        if topic.type in DERIVED_TYPES:
            continue
        messages = [cdr.decode(payload, topic.schema, topic.type) for payload in payloads]
        if topic.type == HEALTH:
            messages = [_without_times(message) for message in messages]
        if name == ANY_ORDER:
            messages.sort(key=lambda row: row[:2])
        recorded[name] = messages
    return recorded


def _without_times(message):
    [status] = message.status
    kept = (one for one in status.values if not EXEMPT.fullmatch(one.key))
    return (status.name, message.header.stamp, status.level, status.message, *kept)


def differences(first: dict[str, list], other: dict[str, list]) -> list[str]:
    """Return a text for each topic that differs."""
    found = []
    for name in sorted({*first, *other}):
        ours, theirs = first.get(name, []), other.get(name, [])
        if ours != theirs:
            at = next((k for k, (a, b) in enumerate(zip(ours, theirs)) if a != b), None)
            where = '' if at is None else f', the first that differs is number {at}'
            found.append(f'{name}: {len(ours)} and {len(theirs)} messages{where}')
    return found


def main() -> int:
    """Print the differences of every run from the first, and how many are equal."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--runs', type=int, default=100)
    options = parser.parse_args()
    differing = 0
    with busy():
        for number in range(options.runs):
            with tempfile.TemporaryDirectory() as folder:
                found = contents(drive(Path(folder)))
            if not number:
                first = found
            texts = differences(first, found)
            differing += bool(texts)
            for text in texts:
                print(f'run {number}: {text}', flush=True)
            print(f'{number + 1 - differing} of {number + 1} equal', flush=True)
    return int(differing > 0)


if __name__ == '__main__':
    sys.exit(main())
