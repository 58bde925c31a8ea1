"""What became of each fault, on which commit and machine: `verdicts.json`."""

import json
import os
from collections.abc import Collection
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple

from stalls import STALL_S

from node_runtime import provenance

KEPT = 'verdicts.json'
TOO_LATE = 'too late'
NOT_CALM = 'not OK before the fault'
DIRTY = '-dirty'


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
    stall_s: float  # time for which the machine stood still, around the fault
    tries: int = 1
    earlier: tuple[str, ...] = ()  # what went wrong in the try before
    commit: str = ''  # of the code, '' outside of its repository
    machine: str = ''
    load: float = 0.0  # of the machine, when the last try began
    at: str = ''  # when that was, UTC

    @property
    def passed(self) -> bool:
        """Whether everything is as it must be."""
        return not self.remarks

    @property
    def late(self) -> bool:
        """Whether something went wrong, and nothing but that something was late.

        A machine that stands still explains that, but no other final state, no process that hung
        or ended, no bag that cannot be read and no command that must not be.
        """
        lateness = [r == TOO_LATE or r.startswith(f'{NOT_CALM}: ') for r in self.remarks]
        return bool(lateness) and all(lateness)

    @property
    def disturbed(self) -> bool:
        """Whether the machine stood still for longer than the nodes can make up for."""
        return self.stall_s > STALL_S

    @property
    def not_calm(self) -> bool:
        """Whether the ring was not OK before the fault: such a run says nothing about the fault."""
        return any(remark.startswith(f'{NOT_CALM}: ') for remark in self.remarks)


def surroundings() -> dict[str, str | float]:
    """Return what a verdict says about code, machine and time."""
    facts = provenance.machine()
    return {
        'commit': provenance.commit(),
        'machine': f'{facts["processor"]}, {facts["cores"]} cores, Linux {facts["kernel"]}',
        'load': round(os.getloadavg()[0], 2),
        'at': datetime.now(timezone.utc).isoformat(timespec='seconds'),
    }


def load(path: Path) -> dict[str, Verdict]:
    """Return the verdicts of a file by the names of their faults, in the order of the runs.

    What an older version noted besides is left out.
    """
    found = {}
    for noted in json.loads(path.read_text()):
        known = {name: value for name, value in noted.items() if name in Verdict._fields}
        found[noted['name']] = Verdict(**known)
    return found


def save(path: Path, verdicts: dict[str, Verdict]) -> None:
    """Write verdicts so that an interruption leaves the old file or the new one."""
    new = path.with_suffix('.new')
    new.write_text(json.dumps([verdict._asdict() for verdict in verdicts.values()], indent=1))
    new.replace(path)


def total(verdicts: Collection[Verdict]) -> str:
    """Return the sum of several verdicts as a sentence."""
    passed = sum(verdict.passed for verdict in verdicts)
    again = sum(verdict.tries - 1 for verdict in verdicts)
    bad = sum(verdict.nonsense for verdict in verdicts)
    return (
        f'{passed} of {len(verdicts)} as expected, {again} tried again, '
        f'{bad} commands that must not be.'
    )


def is_known(verdict: Verdict | None, commit: str) -> bool:
    """Tell whether a fault has a verdict on a commit; uncommitted changes are none."""
    return verdict is not None and verdict.commit == commit and is_clean(commit)


def is_clean(commit: str) -> bool:
    """Tell whether a commit says exactly which code it is."""
    return bool(commit) and not commit.endswith(DIRTY)
