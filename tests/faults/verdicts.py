"""What became of each fault, on which commit and machine: `verdicts.json`."""

import json
import os
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple

from stalls import STALL_S

from bags.experiments import notes

KEPT = 'verdicts.json'
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
    calm: bool = True  # OK all the time in the second before the fault
    tries: int = 1
    earlier: tuple[str, ...] = ()  # what went wrong in the tries before
    commit: str = ''  # of the code, '' outside of its repository
    machine: str = ''
    load: float = 0.0  # of the machine, when the last try began
    at: str = ''  # when that was, UTC

    @property
    def passed(self) -> bool:
        """Whether everything is as it must be."""
        return not self.remarks

    @property
    def disturbed(self) -> bool:
        """Whether the machine stood still: a reason to try again, never to pass."""
        return self.stall_s > STALL_S


def surroundings() -> dict[str, str | float]:
    """Return what a verdict says about code, machine and time."""
    facts = notes.machine()
    return {
        'commit': notes.commit(),
        'machine': f'{facts["processor"]}, {facts["cores"]} cores, Linux {facts["kernel"]}',
        'load': round(os.getloadavg()[0], 2),
        'at': datetime.now(timezone.utc).isoformat(timespec='seconds'),
    }


def load(path: Path) -> dict[str, Verdict]:
    """Return the verdicts of a file by the names of their faults, in the order of the runs."""
    return {one['name']: Verdict(**one) for one in json.loads(path.read_text())}


def save(path: Path, verdicts: dict[str, Verdict]) -> None:
    """Write verdicts so that an interruption leaves the old file or the new one."""
    new = path.with_suffix('.new')
    new.write_text(json.dumps([verdict._asdict() for verdict in verdicts.values()], indent=1))
    new.replace(path)


def is_known(verdict: Verdict | None, commit: str) -> bool:
    """Tell whether a fault has a verdict on a commit; uncommitted changes are none."""
    return verdict is not None and verdict.commit == commit and is_clean(commit)


def is_clean(commit: str) -> bool:
    """Tell whether a commit says exactly which code it is."""
    return bool(commit) and not commit.endswith(DIRTY)
