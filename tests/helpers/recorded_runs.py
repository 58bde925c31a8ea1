"""Calls of `experiments run` as by a user, and their results."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

EXPERIMENTS = Path(sys.prefix, 'bin/experiments')
DRIVEN = ('double_lane_change', 'mpcc', 'mpcc_no_ca', 'frenet')
# what tests/ros/test_realtime.py drives
ON_THE_WALL_CLOCK = ('run', 'double_lane_change', '--mode', 'realtime')
SECONDS = 240  # of wall time for one call; a run takes a few
RUNS = 'bags/runs'  # where `experiments run` puts them
PRINTED = 'printed.txt'


class RecordedRuns(NamedTuple):
    """The results of one call of `experiments run`."""

    folder: Path  # in which the command was called
    scenario: str
    comparison: dict
    printed: str

    @property
    def out(self) -> Path:
        """Return the folder of the scenarios."""
        return self.folder / RUNS

    def bag(self, controller: str) -> Path:
        """Return the folder of the bag of one controller."""
        return self.out / self.scenario / controller


def run_arguments(scenario: str, *controllers: str) -> list[str]:
    """Return the arguments of `experiments` that drive a scenario."""
    return ['run', scenario, *(word for name in controllers for word in ('--controller', name))]


def run_experiment(folder: Path, scenario: str, *controllers: str) -> None:
    """Drive a scenario through the node graph in a free ROS domain; the runs must complete."""
    environment = os.environ | {'COLUMNS': '120'}  # of the pages of the documentation
    environment.pop('ROS_DOMAIN_ID', None)  # it may be reserved for the module of the first test
    result = subprocess.run(
        [EXPERIMENTS, *run_arguments(scenario, *controllers)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    assert result.returncode == 0, f'{folder}:\n{result.stdout}{result.stderr}'
    (folder / PRINTED).write_text(result.stdout + result.stderr)


def load_runs(folder: Path, scenario: str) -> RecordedRuns:
    """Return the results of `run_experiment` in a folder."""
    comparison = json.loads((folder / RUNS / scenario / 'comparison.json').read_text())
    return RecordedRuns(folder, scenario, comparison, (folder / PRINTED).read_text())
