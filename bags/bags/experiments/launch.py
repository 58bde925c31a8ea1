"""A node of the ring as a process: the nodes of a plain ring, their surroundings, their start."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bags.experiments import experiment, processes
from bags.experiments.experiment import Node, ScenarioFacts
from bags.experiments.processes import Process

BAG, NOTES = 'bag', 'run_info.json'


def plain_ring(
    facts: ScenarioFacts, mode: str, folder: Path, overrides: Mapping[str, Mapping[str, Any]]
) -> list[Node]:
    """Return the nodes of a ring with `mpcc`, recorded to `folder`/bag, with nothing noted."""
    notes = folder / NOTES
    notes.write_text('{}')
    mpcc = experiment.controller('mpcc')
    return experiment.nodes(facts, mpcc, mode, folder / BAG, notes, overrides)


def environment(domain: int, logs: Path) -> dict[str, str]:
    """Return the environment of nodes in a ROS domain; they are heard on this machine only.

    Somebody who wants to hear them elsewhere sets ROS_AUTOMATIC_DISCOVERY_RANGE.
    """
    return {
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        **os.environ,
        'ROS_DOMAIN_ID': str(domain),
        'ROS_LOG_DIR': str(logs),
        # one thread per node: the matrices are small
        'OPENBLAS_NUM_THREADS': '1',
        'RCUTILS_COLORIZED_OUTPUT': '0',
    }


def start(
    node: Node,
    folder: Path,
    environment: Mapping[str, str],
    *,
    name: str = '',
    log: str = '',
    program: Sequence[str] = (),
    more: Sequence[str] = (),
    cores: set[int] | None = None,
    nice: int = 0,
) -> Process:
    """Start a node; its parameter file and its log go to `folder`.

    The process is called `name`, or by the role; the log `log`, or by that name. `program` stands
    for the one that is installed, `more` follows the ROS arguments; the rest as in
    `processes.start`.
    """
    written = folder / f'{node.role}.yaml'
    experiment.write_parameters(node, written)
    command = [*(program or processes.resolve(node.package, node.executable))]
    command += [*experiment.arguments(node, written), *more]
    name = name or node.role
    path = folder / (log or f'{name}.log')
    return processes.start(name, command, path, environment, cores, nice)
