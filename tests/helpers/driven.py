"""Calls of `experiments run`, as a user would make them, and what they leave behind."""

import json
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

EXPERIMENTS = Path(sys.prefix, 'bin/experiments')
SECONDS = 240  # of wall time for one call; a run takes a few
PRINTED = 'printed.txt'


class Rings(NamedTuple):
    """What one call of `experiments run` left behind."""

    out: Path
    scenario: str
    comparison: dict
    printed: str

    def bag(self, controller: str) -> Path:
        """Return the folder of the bag of one controller."""
        return self.out / self.scenario / controller


def drive(out: Path, scenario: str, *controllers: str) -> None:
    """Drive a scenario through the node graph in a free ROS domain; the runs must complete."""
    chosen = [word for name in controllers for word in ('--controller', name)]
    done = subprocess.run(
        [EXPERIMENTS, 'run', scenario, *chosen, '--out', out],
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    assert done.returncode == 0, f'{out}:\n{done.stdout}{done.stderr}'
    (out / PRINTED).write_text(done.stdout + done.stderr)


def load(out: Path, scenario: str) -> Rings:
    """Return what `drive` left in a folder."""
    comparison = json.loads((out / scenario / 'comparison.json').read_text())
    return Rings(out, scenario, comparison, (out / PRINTED).read_text())
