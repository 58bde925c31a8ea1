"""Where a table comes from: command, code, versions, machine, seeds. It stands in every file."""

from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from experiments.configuration import inputs
from experiments.study import code_version, samples
from node_runtime import provenance


def of(
    command: str, scenario: str, seed: int, roles: Mapping[str, str], **more: Any
) -> dict[str, Any]:
    """Return the provenance of a part of a study; `more` are its own numbers.

    `roles` are who was driven: controllers by the name that the table gives them.
    """
    return {
        'command': command,
        # a file by its name alone: where it lay on this machine tells nobody anything
        'roles': {role: Path(controller).name for role, controller in roles.items()},
        'commit': provenance.commit(),
        'code_sha256': code_version.digest(),
        'scenario': scenario,
        'scenario_sha256': provenance.digest(inputs.load_scenario(scenario).text),
        'seed': seed,
        'spread': {
            'speed_kph': samples.SPEED_KPH,
            'grip': samples.GRIP,
            'tolerance': list(samples.TOLERANCE),
        },
        'versions': provenance.versions() | {'scipy': metadata.version('scipy')},
        'machine': provenance.machine(),
        **more,
    }


def line(found: dict[str, Any]) -> str:
    """Return it as one line for a person."""
    machine, roles = found['machine'], found['roles']
    played = ', '.join(f'{role} = {controller}' for role, controller in roles.items())
    return (
        f'`{found["command"]}` with {played}; '
        f'commit {found["commit"][:12] or "unknown"}, seed {found["seed"]}, '
        f'{machine["processor"]} with {machine["cores"]} cores.'
    )
