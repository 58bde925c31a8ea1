"""Run faults on the node graph and report the final state of the car in each run.

    python tests/faults/suite.py                      every fault
    python tests/faults/suite.py odometry_nan disk_full
    python tests/faults/suite.py --some 12 --seed 1   a seeded selection
    python tests/faults/suite.py --out build/faults   bags, logs and verdicts.json are kept

Exits with 1 when a run ended in another state than expected, too late, with a car that was not OK
before the fault, with an invalid command, with a process that hung, or with an unreadable bag. A
run in realtime is repeated once when lateness is its only deviation, and

- the car was not OK before the fault, so that the run says nothing about the fault, or
- the machine stalled around the fault: a thread on one of its processors, with a priority above
  the nodes', was not scheduled for 0.04 s of a tenth of a second.

All faults together have two retries; the next late one has failed. A retry waits until the machine
had no stall for 2 s, a minute at most. The nodes run with real-time priority too: a busy machine is
a different fault.

Node graphs start, end and are evaluated in parallel, in two lanes where the user may set real-time
priority; only one drive on the wall clock takes place at a time.

With --out of an earlier run, faults with a result on the same commit are not run again, so an
interrupted suite continues. With uncommitted changes everything is run.
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
import fault_results
import fault_run
import lanes
import stalls
import states
from catalogue import Fault
from fault_results import NOT_OK_BEFORE, TOO_LATE, FaultResult
from fault_run import Evidence

from bags.errors import BagError, DamagedBagWarning
from bags.storage import read, repair
from experiments.run import domain
from node_runtime import provenance

RETRIES = 2  # of all faults together
HEAD = f'{"fault":<32} {"expected":<9} {"final":<9} {"after":>6} {"bound":>6}  remarks'


def evaluate(fault: Fault, evidence: Evidence) -> FaultResult:
    """Return the result of a run."""
    remarks = [f'hung: {name}' for name in evidence.hung]
    remarks += [f'ended early: {name}' for name in evidence.ended]
    final, invalid = states.FinalState('none', float('inf'), (), ''), 0
    try:
        load_bag(evidence.bag)
        bag = load_bag(evidence.witness)
        plant_lives = not (fault.action in ('kill', 'freeze') and fault.target == 'plant')
        plant_lives = plant_lives or 'for_s' in fault.settings
        if evidence.begins_ns is None:
            raise BagError('the run never reached the fault')
        final = states.final_state(bag, evidence.begins_ns, plant_lives)
        invalid = count_invalid_commands(fault, bag)
    except BagError as error:
        remarks.append(str(error))
    if final.state != fault.expect:
        remarks.append(f'is {final.state}')
    elif final.settled_s > fault.within_s:
        remarks.append(TOO_LATE)
    if final.before:
        remarks.append(f'{NOT_OK_BEFORE}: {final.before}')
    if invalid:
        remarks.append(f'{invalid} invalid commands')
    return FaultResult(
        name=fault.name,
        expected=fault.expect,
        final_state=final.state,
        settled_s=final.settled_s,
        within_s=fault.within_s,
        visited=final.visited,
        invalid_commands=invalid,
        remarks=tuple(remarks),
        # in lockstep the nodes wait, so a stall changes nothing
        stall_s=0.0 if fault.mode == 'lockstep' else evidence.stall_s,
    )


def count_invalid_commands(fault: Fault, bag: read.Bag) -> int:
    """Return how many invalid commands a bag has, see `states.count_invalid_commands`."""
    return states.count_invalid_commands(bag, fault.target if fault.action == 'relay' else ())


def load_bag(folder: Path) -> read.Bag:
    """Return a bag, repaired where its recorder could not complete it."""
    repair.repair_bag(folder)
    with warnings.catch_warnings():
        warnings.simplefilter('error', DamagedBagWarning)
        return read.load(folder)


def row(result: FaultResult) -> str:
    """Return one line of the table."""
    remarks = '; '.join(result.remarks) or ' -> '.join(result.visited)
    if result.tries > 1:
        remarks += f' (try {result.tries}; before: {"; ".join(result.first_try)})'
    if result.was_stalled:
        remarks += f' (the machine stalled for {result.stall_s:.2f} s)'
    return (
        f'{result.name:<32} {result.expected:<9} {result.final_state:<9} '
        f'{result.settled_s:>6.2f} {result.within_s:>6.2f}  '
        f'{"" if result.passed else "FAILED: "}{remarks}'
    )


class Retries:
    """The retries left for late runs, one number for the whole suite."""

    def __init__(self, used: int = 0):
        self.left = RETRIES - used

    def grant(self, fault: Fault, result: FaultResult) -> bool:
        """Return whether a run is retried, and count it. Runs in lockstep are never retried."""
        may_retry = fault.mode == 'realtime' and result.is_only_late
        may_retry = may_retry and (result.was_stalled or result.was_not_ok_before)
        granted = self.left > 0 and result.tries == 1 and may_retry
        self.left -= granted
        return granted


def run_once(fault: Fault, out: Path, before: FaultResult | None) -> FaultResult:
    """Run a fault in a ROS domain of its own; `before` is the result of the first try, if any."""
    tries = 1 if before is None else before.tries + 1
    folder = out / (fault.name if before is None else f'{fault.name}.{tries}')
    if before:
        stalls.wait_until_calm()
    shutil.rmtree(folder, ignore_errors=True)  # of an interrupted or earlier run
    context = fault_results.run_context()
    with domain.reserved({}) as number:
        evidence = fault_run.run_fault(fault, folder, number)
    first_try = ()
    if before:
        first_try = (*before.remarks, f'the machine stalled for {before.stall_s:.2f} s')
    return evaluate(fault, evidence)._replace(tries=tries, first_try=first_try, **context)


def run_faults(
    faults: Iterable[Fault], out: Path, retries: Retries, count: int = 1
) -> Iterator[FaultResult]:
    """Run faults in `count` lanes, late ones twice; yield the last result of each."""
    queue = [(fault, out, None) for fault in faults]
    with lanes.Lanes(count) as pool:
        for (fault, *_), result in pool.results(run_once, queue):
            if retries.grant(fault, result):
                queue.insert(0, (fault, out, result))
            else:
                yield result


def run_suite(faults: list[Fault], out: Path, count: int = 1) -> list[FaultResult]:
    """Run the faults without a result on this commit, in `count` lanes; print a line of each."""
    print(HEAD, flush=True)
    file, commit = out / fault_results.RESULTS_FILE, provenance.commit()
    results = fault_results.load(file) if file.is_file() else {}
    known = {n: result for n, result in results.items() if fault_results.is_current(result, commit)}
    for fault in faults:
        if fault.name in known:
            print(row(known[fault.name]), flush=True)
    missing = [fault for fault in faults if fault.name not in known]
    retries = Retries(used=sum(result.tries - 1 for result in known.values()))
    for result in run_faults(missing, out, retries, count):
        results.pop(result.name, None)  # the file is in the order of the runs
        results[result.name] = result
        fault_results.save(file, results)
        print(row(result), flush=True)
    return [results[fault.name] for fault in faults]


def select(faults: list[Fault], patterns: list[str], some: int | None, seed: int) -> list[Fault]:
    """Return the faults that match a pattern, or a seeded sample of them, in their order.

    Raises SystemExit for a pattern without a match.
    """
    for pattern in patterns:
        if not fnmatch.filter((fault.name for fault in faults), pattern):
            raise SystemExit(f'no fault is called {pattern!r}')
    matches = [
        f for f in faults if not patterns or any(fnmatch.fnmatch(f.name, p) for p in patterns)
    ]
    if some is None:
        return matches
    sample = random.Random(seed).sample(matches, min(some, len(matches)))
    return [fault for fault in matches if fault in sample]


def main() -> int:
    """Run the selected faults; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('names', nargs='*', help='of faults, with * and ?; default: all')
    parser.add_argument('--mode', choices=catalogue.MODES, help='only the faults of a mode')
    parser.add_argument('--some', type=int, help='a sample of this size, selected by --seed')
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--out', type=Path, help='folder for bags, logs and verdicts.json')
    parser.add_argument(
        '--lanes', type=int, default=lanes.default(), help='runs at a time; default: %(default)s'
    )
    options = parser.parse_args()
    of_mode = [f for f in catalogue.load() if options.mode in (None, f.mode)]
    faults = select(of_mode, options.names, options.some, options.seed)
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        results = run_suite(faults, (options.out or Path(scratch)).absolute(), options.lanes)
    minutes = (time.monotonic() - began) / 60
    print(f'{fault_results.summarize(results)} {minutes:.1f} min.')
    return 0 if all(result.passed for result in results) else 1


if __name__ == '__main__':
    sys.exit(main())
