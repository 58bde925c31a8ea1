"""Try faults on the ring, and say which state each ended in.

    python tests/faults/suite.py                      every fault
    python tests/faults/suite.py odometry_nan disk_full
    python tests/faults/suite.py --some 12 --seed 1   a seeded choice

Exits with 1 when one ended in another state than expected, too late, with a command that must not
be, with a process that hung, or with a bag that cannot be read. --out keeps bags and logs. A run on
the wall clock that fails is tried again when the machine disturbed it: when the car was not OK
before the fault, or this process got no turn for 40 ms. Where the user may, the nodes run with
real-time priority: a busy machine is another fault.
"""

import argparse
import fnmatch
import json
import random
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import NamedTuple

import catalogue
import ring
import states
from catalogue import Fault
from ring import Evidence

from bags.errors import BagError, DamagedBagWarning
from bags.storage import read, repair

DOMAIN = 70
TRIES = 3  # on the wall clock, of a run that the machine disturbed
STALL_S = 0.04
TOO_LATE = 'too late'
HEAD = f'{"fault":<32} {"expected":<9} {"found":<9} {"after":>6} {"bound":>6}  remarks'


class Verdict(NamedTuple):
    """What became of a fault."""

    name: str
    expected: str
    found: str
    settled_s: float
    within_s: float
    visited: tuple[str, ...]
    nonsense: int  # commands that must not be
    remarks: tuple[str, ...]  # everything that went wrong
    disturbed: str  # what else went wrong with the machine, '' for nothing
    tries: int = 1

    @property
    def passed(self) -> bool:
        """Whether everything is as it must be."""
        return not self.remarks

    @property
    def unclear(self) -> bool:
        """Whether all that is wrong is a state or its time, on a machine that was disturbed."""
        return bool(self.disturbed) and set(self.remarks) <= {f'is {self.found}', TOO_LATE}


def judge(fault: Fault, evidence: Evidence) -> Verdict:
    """Return what became of a fault."""
    remarks = [f'hung: {name}' for name in evidence.hung]
    remarks += [f'ended early: {name}' for name in evidence.ended]
    found, settled_s, visited, bad, calm = 'none', float('inf'), (), 0, True
    try:
        readable(evidence.bag)
        bag = readable(evidence.witness)
        plant_lives = not (fault.does in ('kill', 'freeze') and fault.to == 'plant')
        plant_lives = plant_lives or 'for_s' in fault.settings
        if evidence.begins_ns is None:
            raise BagError('the run never came to the fault')
        found, settled_s, visited, calm = states.ending(bag, evidence.begins_ns, plant_lives)
        bad = harmful(fault, bag)
    except BagError as error:
        remarks.append(str(error))
    if found != fault.expect:
        remarks.append(f'is {found}')
    elif settled_s > fault.within_s:
        remarks.append(TOO_LATE)
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
        disturbed=disturbance(fault, evidence, calm),
    )


def disturbance(fault: Fault, evidence: Evidence, calm: bool) -> str:
    """Return what happened to a run beside its fault, '' for nothing.

    A run that never came to its fault says nothing about it; on the wall clock the machine may
    have disturbed it.
    """
    if evidence.begins_ns is None:
        return 'never came to the fault'
    if fault.mode != 'realtime':
        return ''
    if not calm:
        return 'not OK before the fault'
    if evidence.stall_s > STALL_S:
        return f'the machine stood still for {evidence.stall_s:.2f} s'
    return ''


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
        remarks += f' (try {verdict.tries})'
    if verdict.disturbed:
        remarks += f' ({verdict.disturbed})'
    return (
        f'{verdict.name:<32} {verdict.expected:<9} {verdict.found:<9} '
        f'{verdict.settled_s:>6.2f} {verdict.within_s:>6.2f}  '
        f'{"" if verdict.passed else "FAILED: "}{remarks}'
    )


def attempt(fault: Fault, out: Path, domain: int) -> Verdict:
    """Try a fault; again when it failed in a run that was disturbed."""
    for tries in range(1, TRIES + 1):
        folder = out / (fault.name if tries == 1 else f'{fault.name}.{tries}')
        verdict = judge(fault, ring.drive(fault, folder, domain))._replace(tries=tries)
        if verdict.passed or not verdict.disturbed:
            break
    return verdict


def run(faults: list[Fault], out: Path, domain: int) -> list[Verdict]:
    """Try faults one after the other; print a line about each."""
    print(HEAD, flush=True)
    verdicts = []
    for fault in faults:
        verdicts.append(attempt(fault, out, domain))
        print(row(verdicts[-1]), flush=True)
        kept = out / 'verdicts.json'
        kept.write_text(json.dumps([v._asdict() for v in verdicts], indent=1))
    return verdicts


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
    parser.add_argument('--out', type=Path, help='folder to create for bags and logs')
    parser.add_argument('--domain', type=int, default=DOMAIN, help='ROS_DOMAIN_ID')
    given = parser.parse_args()
    known = [f for f in catalogue.load() if given.mode in (None, f.mode)]
    faults = chosen(known, given.names, given.some, given.seed)
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        verdicts = run(faults, (given.out or Path(scratch)).absolute(), given.domain)
    passed = sum(verdict.passed for verdict in verdicts)
    minutes = (time.monotonic() - began) / 60
    bad = sum(verdict.nonsense for verdict in verdicts)
    print(f'{passed} of {len(verdicts)} as expected, {bad} commands that must not be, ', end='')
    print(f'{minutes:.1f} min')
    return 0 if passed == len(verdicts) else 1


if __name__ == '__main__':
    sys.exit(main())
