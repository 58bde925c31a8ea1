"""Calls of `experiments run` as by a user, and their results."""

import json
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

EXPERIMENTS = Path(sys.prefix, 'bin/experiments')
SECONDS = 240  # of wall time for one call; a run takes a few
PRINTED = 'printed.txt'


class RecordedRuns(NamedTuple):
    """The results of one call of `experiments run`."""

    out: Path
    scenario: str
    comparison: dict
    printed: str

    def bag(self, controller: str) -> Path:
        """Return the folder of the bag of one controller."""
        return self.out / self.scenario / controller


def run_experiment(out: Path, scenario: str, *controllers: str) -> None:
    """Drive a scenario through the node graph in a free ROS domain; the runs must complete."""
    arguments = [word for name in controllers for word in ('--controller', name)]
    result = subprocess.run(
        [EXPERIMENTS, 'run', scenario, *arguments, '--out', out],
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    assert result.returncode == 0, f'{out}:\n{result.stdout}{result.stderr}'
    (out / PRINTED).write_text(result.stdout + result.stderr)


def load_runs(out: Path, scenario: str) -> RecordedRuns:
    """Return the results of `run_experiment` in a folder."""
    comparison = json.loads((out / scenario / 'comparison.json').read_text())
    return RecordedRuns(out, scenario, comparison, (out / PRINTED).read_text())
