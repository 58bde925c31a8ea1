"""Try faults on the ring, and say which state each ended in.

    python tests/faults/suite.py                      every fault
    python tests/faults/suite.py odometry_nan disk_full
    python tests/faults/suite.py --some 12 --seed 1   a seeded choice
    python tests/faults/suite.py --out build/faults   bags, logs and verdicts.json are kept

Exits with 1 when one ended in another state than expected, too late, with a car that was not OK
before the fault, with a command that must not be, with a process that hung, or with a bag that
cannot be read. A run in realtime is tried again, once, when it was late and nothing else, and

- the car was not OK before the fault, so that the run says nothing about the fault, or
- the machine was seen to stand still around the fault: a thread on one of its processors, with a
  priority above the nodes', got no turn for 0.04 s of a tenth of a second.

Of all faults together two may be tried again; the next one that is late has failed. The second try
waits until all threads had their turns for 2 s, a minute at most. The nodes run with priority too:
a busy machine is another fault.

Rings start, end and are judged beside each other, in two lanes where the user may give real-time
priority; one drive on the wall clock takes place at a time.

With --out of an earlier run, what has a verdict on the same commit is not run again: an interrupted
suite goes on where it was. Uncommitted changes are no commit; with them everything is run.
"""

import argparse
import fnmatch
import random
import shutil
import sys
import tempfile
import time
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path

import catalogue
import lanes
import ring
import stalls
import states
import verdicts
from catalogue import Fault
from ring import Evidence
from verdicts import NOT_CALM, TOO_LATE, Verdict

from bags.errors import BagError, DamagedBagWarning
from bags.storage import read, repair
from experiments.run import domain
from node_runtime import provenance

RETRIES = 2  # of all faults together
HEAD = f'{"fault":<32} {"expected":<9} {"found":<9} {"after":>6} {"bound":>6}  remarks'


def judge(fault: Fault, evidence: Evidence) -> Verdict:
    """Return what became of a fault."""
    remarks = [f'hung: {name}' for name in evidence.hung]
    remarks += [f'ended early: {name}' for name in evidence.ended]
    found, settled_s, visited, bad, before = 'none', float('inf'), (), 0, ''
    try:
        readable(evidence.bag)
        bag = readable(evidence.witness)
        plant_lives = not (fault.does in ('kill', 'freeze') and fault.to == 'plant')
        plant_lives = plant_lives or 'for_s' in fault.settings
        if evidence.begins_ns is None:
            raise BagError('the run never came to the fault')
        found, settled_s, visited, before = states.ending(bag, evidence.begins_ns, plant_lives)
        bad = harmful(fault, bag)
    except BagError as error:
        remarks.append(str(error))
    if found != fault.expect:
        remarks.append(f'is {found}')
    elif settled_s > fault.within_s:
        remarks.append(TOO_LATE)
    if before:
        remarks.append(f'{NOT_CALM}: {before}')
    if bad:
        remarks.append(f'{bad} commands that must not be')
    return Verdict(
        name=fault.name,
        expected=fault.expect,
        found=found,
        settled_s=settled_s,
        within_s=fault.within_s,
        visited=visited,
        nonsense=bad,
        remarks=tuple(remarks),
        # a drive in lockstep waits
        stall_s=0.0 if fault.mode == 'lockstep' else evidence.stall_s,
    )


def harmful(fault: Fault, bag: read.Bag) -> int:
    """Return how many commands there were that must not be."""
    return states.nonsense(bag, fault.to if fault.does == 'relay' else ())


def readable(folder: Path) -> read.Bag:
    """Return a bag, mended where its recorder could not complete it."""
    repair.repair_bag(folder)
    with warnings.catch_warnings():
        warnings.simplefilter('error', DamagedBagWarning)
        return read.load(folder)


def row(verdict: Verdict) -> str:
    """Return one line of the table."""
    remarks = '; '.join(verdict.remarks) or ' -> '.join(verdict.visited)
    if verdict.tries > 1:
        remarks += f' (try {verdict.tries}; before: {"; ".join(verdict.earlier)})'
    if verdict.disturbed:
        remarks += f' (the machine stood still for {verdict.stall_s:.2f} s)'
    return (
        f'{verdict.name:<32} {verdict.expected:<9} {verdict.found:<9} '
        f'{verdict.settled_s:>6.2f} {verdict.within_s:>6.2f}  '
        f'{"" if verdict.passed else "FAILED: "}{remarks}'
    )


class Retries:
    """How many runs that were late may still be tried again: one number for a whole suite."""

    def __init__(self, used: int = 0):
        self.left = RETRIES - used

    def grant(self, fault: Fault, verdict: Verdict) -> bool:
        """Tell whether a run is tried again, and count it. In lockstep a drive waits: none is."""
        excused = fault.mode == 'realtime' and verdict.late
        excused = excused and (verdict.disturbed or verdict.not_calm)
        granted = self.left > 0 and verdict.tries == 1 and excused
        self.left -= granted
        return granted


def try_once(fault: Fault, out: Path, before: Verdict | None) -> Verdict:
    """Run a fault in a ROS domain of its own; `before` is what came of the first try."""
    tries = 1 if before is None else before.tries + 1
    folder = out / (fault.name if before is None else f'{fault.name}.{tries}')
    if before:
        stalls.wait_until_calm()
    shutil.rmtree(folder, ignore_errors=True)  # of an interrupted or earlier run
    around = verdicts.surroundings()
    with domain.reserved({}) as number:
        evidence = ring.drive(fault, folder, number)
    earlier = ()
    if before:
        earlier = (*before.remarks, f'the machine stood still for {before.stall_s:.2f} s')
    return judge(fault, evidence)._replace(tries=tries, earlier=earlier, **around)


def outcomes(
    faults: Iterable[Fault], out: Path, retries: Retries, count: int = 1
) -> Iterator[Verdict]:
    """Try faults in `count` lanes; yield the last verdict on each as soon as there is one."""
    to_do = [(fault, out, None) for fault in faults]
    with lanes.Lanes(count) as several:
        for (fault, *_), verdict in several.results(try_once, to_do):
            if retries.grant(fault, verdict):
                to_do.insert(0, (fault, out, verdict))
            else:
                yield verdict


def attempt(fault: Fault, out: Path, retries: Retries) -> Verdict:
    """Try one fault, again when it was late, and return what came of it."""
    (verdict,) = outcomes([fault], out, retries)
    return verdict


def run(faults: list[Fault], out: Path, count: int = 1) -> list[Verdict]:
    """Try what was not tried on this commit, in `count` lanes; print a line about each."""
    print(HEAD, flush=True)
    kept, commit = out / verdicts.KEPT, provenance.commit()
    found = verdicts.load(kept) if kept.is_file() else {}
    known = {name: one for name, one in found.items() if verdicts.is_known(one, commit)}
    for fault in faults:
        if fault.name in known:
            print(row(known[fault.name]), flush=True)
    to_do = [fault for fault in faults if fault.name not in known]
    retries = Retries(used=sum(one.tries - 1 for one in known.values()))
    for verdict in outcomes(to_do, out, retries, count):
        found.pop(verdict.name, None)  # the file is in the order of the runs
        found[verdict.name] = verdict
        verdicts.save(kept, found)
        print(row(verdict), flush=True)
    return [found[fault.name] for fault in faults]


def chosen(faults: list[Fault], patterns: list[str], some: int | None, seed: int) -> list[Fault]:
    """Return the faults whose name fits a pattern, or a seeded choice of them, in their order."""
    for pattern in patterns:
        if not fnmatch.filter((fault.name for fault in faults), pattern):
            raise SystemExit(f'no fault is called {pattern!r}')
    fitting = [
        f for f in faults if not patterns or any(fnmatch.fnmatch(f.name, p) for p in patterns)
    ]
    if some is None:
        return fitting
    few = random.Random(seed).sample(fitting, min(some, len(fitting)))
    return [fault for fault in fitting if fault in few]


def main() -> int:
    """Try the chosen faults."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('names', nargs='*', help='of faults, with * and ?; default: all')
    parser.add_argument('--mode', choices=catalogue.MODES, help='only those of a mode')
    parser.add_argument('--some', type=int, help='so many of them, chosen by --seed')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--out', type=Path, help='folder for bags, logs and verdicts.json')
    parser.add_argument(
        '--lanes', type=int, default=lanes.default(), help='rings at a time; default: %(default)s'
    )
    given = parser.parse_args()
    known = [f for f in catalogue.load() if given.mode in (None, f.mode)]
    faults = chosen(known, given.names, given.some, given.seed)
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        found = run(faults, (given.out or Path(scratch)).absolute(), given.lanes)
    minutes = (time.monotonic() - began) / 60
    print(f'{verdicts.total(found)} {minutes:.1f} min.')
    return 0 if all(verdict.passed for verdict in found) else 1


if __name__ == '__main__':
    sys.exit(main())
