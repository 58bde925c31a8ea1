"""Try faults on the ring, and say which state each ended in.

    python tests/faults/suite.py                      every fault
    python tests/faults/suite.py odometry_nan disk_full
    python tests/faults/suite.py --some 12 --seed 1   a seeded choice
    python tests/faults/suite.py --out build/faults   bags, logs and verdicts.json are kept

Exits with 1 when one ended in another state than expected, too late, with a car that was not OK
before the fault, with a command that must not be, with a process that hung, or with a bag that
cannot be read. A failed run is tried again when it says nothing about the fault: once when the car
was not OK before it, at most four times when the machine was seen to stand still around it: a
thread on one of its processors, with a priority above the nodes' where the user may, got no turn
for 0.04 s of a tenth of a second. The next try waits until all had their turns for 2 s, a minute at
most. After that it has failed. The nodes run with priority too: a busy machine is another fault.

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
from pathlib import Path

import catalogue
import ring
import stalls
import states
import verdicts
from catalogue import Fault
from ring import Evidence
from verdicts import Verdict

from bags.errors import BagError, DamagedBagWarning
from bags.experiments import notes
from bags.storage import read, repair

DOMAIN = 70
TRIES = 5  # of a run that says nothing about its fault
TOO_LATE = 'too late'
NOT_CALM = 'not OK before the fault'
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
        stall_s=counting_stall(fault, evidence),
        calm=not before,
    )


def counting_stall(fault: Fault, evidence: Evidence) -> float:
    """Return how long the machine stood still where it matters [s].

    A drive in lockstep waits; only its start has limits on the wall clock.
    """
    waits = fault.mode == 'lockstep' and evidence.begins_ns is not None
    return 0.0 if waits else evidence.stall_s


def harmful(fault: Fault, bag: read.Bag) -> int:
    """Return how many commands there were that must not be."""
    return states.nonsense(bag, fault.to if fault.does == 'relay' else ())


def readable(folder: Path) -> read.Bag:
    """Return a bag, mended where its recorder could not complete it."""
    repair.repair(folder)
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


def attempt(fault: Fault, out: Path, domain: int) -> Verdict:
    """Try a fault; again when the run failed and says nothing about it."""
    earlier: list[str] = []
    for tries in range(1, TRIES + 1):
        if tries > 1:
            stalls.wait_until_calm()
        folder = out / (fault.name if tries == 1 else f'{fault.name}.{tries}')
        shutil.rmtree(folder, ignore_errors=True)  # of an interrupted or earlier run
        around = verdicts.surroundings()
        verdict = judge(fault, ring.drive(fault, folder, domain))
        if verdict.passed or not excused(fault, verdict, tries):
            break
        earlier += verdict.remarks
    told = tuple(dict.fromkeys(earlier)) if tries > 1 else ()
    return verdict._replace(tries=tries, earlier=told, **around)


def excused(fault: Fault, verdict: Verdict, tries: int) -> bool:
    """Tell whether a failed run, the first is 1, says nothing about its fault.

    A car that was not OK before it is an excuse once only, and none in lockstep, where a drive is
    the same every time; nothing excuses a command that must not be.
    """
    unfit = not verdict.calm and fault.mode == 'realtime' and tries == 1
    return (unfit or verdict.disturbed) and not verdict.nonsense


def run(faults: list[Fault], out: Path, domain: int) -> list[Verdict]:
    """Try what was not tried on this commit, one after the other; print a line about each."""
    print(HEAD, flush=True)
    kept, commit = out / verdicts.KEPT, notes.commit()
    found = verdicts.load(kept) if kept.is_file() else {}
    for fault in faults:
        if not verdicts.is_known(found.get(fault.name), commit):
            found.pop(fault.name, None)  # the file is in the order of the runs
            found[fault.name] = attempt(fault, out, domain)
            verdicts.save(kept, found)
        print(row(found[fault.name]), flush=True)
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
    parser.add_argument('--domain', type=int, default=DOMAIN, help='ROS_DOMAIN_ID')
    given = parser.parse_args()
    known = [f for f in catalogue.load() if given.mode in (None, f.mode)]
    faults = chosen(known, given.names, given.some, given.seed)
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        found = run(faults, (given.out or Path(scratch)).absolute(), given.domain)
    passed = sum(verdict.passed for verdict in found)
    minutes = (time.monotonic() - began) / 60
    bad = sum(verdict.nonsense for verdict in found)
    print(f'{passed} of {len(found)} as expected, {bad} commands that must not be, ', end='')
    print(f'{minutes:.1f} min')
    return 0 if passed == len(found) else 1


if __name__ == '__main__':
    sys.exit(main())
