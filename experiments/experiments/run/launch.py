"""The nodes of a ring as processes: what is written for them, their environment, their start."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from experiments.configuration import experiment
from experiments.configuration.experiment import Controller, Node, ScenarioFacts
from experiments.run import processes
from experiments.run.processes import Process
from node_runtime import executables, provenance

BAG, NOTES = 'bag', 'run_info.json'
# for every node, unless the user's environment sets them
DEFAULT_ENVIRONMENT = {
    # nodes are heard on this machine only
    'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
}
# for every node: one thread, the matrices are small
FIXED_ENVIRONMENT = {'OPENBLAS_NUM_THREADS': '1'}


def note(
    facts: ScenarioFacts,
    chosen: Controller,
    mode: str,
    ring: Sequence[Node],
    run_info: Path,
    file_values: Mapping[str, Mapping[str, Any]],
) -> None:
    """Write the run information, which the recorder of the ring stores in its bag.

    Scenario, versions, machine and the parameters of every node, which is what `bags compare`
    needs. `file_values` is from `inputs.file_values`.
    """
    parameters = experiment.noted(ring, file_values)
    noted = provenance.of(facts.name, facts.text, chosen.name, mode, parameters)
    run_info.write_text(json.dumps(noted, indent=2))


def plain_ring(
    facts: ScenarioFacts, mode: str, folder: Path, overrides: Mapping[str, Mapping[str, Any]]
) -> list[Node]:
    """Return the nodes of a ring with `mpcc`, recorded to `folder`/bag, with nothing noted."""
    run_info = folder / NOTES
    run_info.write_text('{}')
    mpcc = experiment.controller('mpcc')
    return experiment.nodes(facts, mpcc, mode, folder / BAG, run_info, overrides)


def environment(domain: int, logs: Path) -> dict[str, str]:
    """Return the environment of nodes in a ROS domain; they are heard on this machine only.

    Somebody who wants to hear them elsewhere sets ROS_AUTOMATIC_DISCOVERY_RANGE.
    """
    return {
        **DEFAULT_ENVIRONMENT,
        **os.environ,
        **FIXED_ENVIRONMENT,
        'ROS_DOMAIN_ID': str(domain),
        'ROS_LOG_DIR': str(logs),
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
    written = experiment.write_parameters(node, folder)
    command = [*(program or executables.resolve(node.package, node.executable))]
    command += [*experiment.arguments(node, written), *more]
    name = name or node.role
    path = folder / (log or f'{name}.log')
    return processes.start(name, command, path, environment, cores, nice)
