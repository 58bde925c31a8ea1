"""What was driven and by whom, in words: from the recorded scenario and controller files."""

from collections.abc import Mapping, Sequence
from typing import Any

import yaml

SCENARIO_TEXT = 'scenario_text'
CONTROLLER_TEXT = 'controller_description'  # the comment at the top of the parameter file
UNKNOWN = 'the recording holds no description'


def describe_runs(names: Sequence[str], infos: Sequence[Mapping[str, str]]) -> dict[str, Any]:
    """Return what the report says of runs by their names; `infos` are their metadata records `run`.

    They are the texts `scenario` and `scenario_file`, '' where the recording does not hold it, and
    `controllers` by run.
    """
    text = infos[0].get(SCENARIO_TEXT, '')
    controllers = {name: info.get(CONTROLLER_TEXT) or UNKNOWN for name, info in zip(names, infos)}
    try:
        described = yaml.safe_load(text)['description']
    except (yaml.YAMLError, TypeError, KeyError):
        described = None
    return {
        'scenario': str(described or UNKNOWN),
        'scenario_file': text,
        'controllers': controllers,
    }


def leading_comment(text: str) -> str:
    """Return the comment at the top of a YAML file, without the `#`, as one paragraph."""
    lines = []
    for line in text.splitlines():
        if not line.startswith('#'):
            break
        lines.append(line.lstrip('#').strip())
    return ' '.join(line for line in lines if line)
