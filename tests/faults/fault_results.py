"""Results of fault runs, with their commit and machine, in `verdicts.json`."""

import json
import os
from collections.abc import Collection
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple

from stalls import STALL_S

from node_runtime import provenance

RESULTS_FILE = 'verdicts.json'
TOO_LATE = 'too late'
NOT_OK_BEFORE = 'not OK before the fault'
DIRTY = '-dirty'


class FaultResult(NamedTuple):
    """The result of one fault."""

    name: str
    expected: str
    final_state: str
    settled_s: float
    within_s: float
    visited: tuple[str, ...]
    invalid_commands: int
    remarks: tuple[str, ...]  # every deviation from what is expected
    stall_s: float  # stall of the machine around the fault
    tries: int = 1
    first_try: tuple[str, ...] = ()  # remarks of the first try, where there was a second one
    commit: str = ''  # of the code, '' outside of its repository
    machine: str = ''
    load: float = 0.0  # load average when the last try began
    at: str = ''  # start of the last try, UTC

    @property
    def passed(self) -> bool:
        """Whether nothing deviates from what is expected."""
        return not self.remarks

    @property
    def is_only_late(self) -> bool:
        """Whether there are remarks and all of them are about lateness.

        A stall of the machine explains lateness. It explains no other final state, no process that
        hung or ended, no unreadable bag and no invalid command.
        """
        lateness = [r == TOO_LATE or r.startswith(f'{NOT_OK_BEFORE}: ') for r in self.remarks]
        return bool(lateness) and all(lateness)

    @property
    def was_stalled(self) -> bool:
        """Whether the machine stalled for longer than the nodes can compensate."""
        return self.stall_s > STALL_S

    @property
    def was_not_ok_before(self) -> bool:
        """Whether the car was not OK before the fault: the run says nothing about the fault."""
        return any(remark.startswith(f'{NOT_OK_BEFORE}: ') for remark in self.remarks)


def run_context() -> dict[str, str | float]:
    """Return commit, machine, load and time as fields of a FaultResult."""
    machine = provenance.machine()
    return {
        'commit': provenance.commit(),
        'machine': f'{machine["processor"]}, {machine["cores"]} cores, Linux {machine["kernel"]}',
        'load': round(os.getloadavg()[0], 2),
        'at': datetime.now(timezone.utc).isoformat(timespec='seconds'),
    }


def load(path: Path) -> dict[str, FaultResult]:
    """Return the results of a file by the names of their faults, in the order of the runs."""
    return {entry['name']: FaultResult(**entry) for entry in json.loads(path.read_text())}


def save(path: Path, results: dict[str, FaultResult]) -> None:
    """Write results; an interruption leaves either the old or the new file."""
    new = path.with_suffix('.new')
    new.write_text(json.dumps([result._asdict() for result in results.values()], indent=1))
    new.replace(path)


def summarize(results: Collection[FaultResult]) -> str:
    """Return the totals of several results as a sentence."""
    passed = sum(result.passed for result in results)
    retried = sum(result.tries - 1 for result in results)
    invalid = sum(result.invalid_commands for result in results)
    return f'{passed} of {len(results)} as expected, {retried} retried, {invalid} invalid commands.'


def is_current(result: FaultResult | None, commit: str) -> bool:
    """Return whether a fault has a result on a commit without uncommitted changes."""
    return result is not None and result.commit == commit and is_clean(commit)


def is_clean(commit: str) -> bool:
    """Return whether a commit identifies the code exactly."""
    return bool(commit) and not commit.endswith(DIRTY)
