"""The ranges, arms, preconditions and claims of the study: config/settings_study.yaml."""

import json
from types import SimpleNamespace as Plan

import yaml

from experiments.batch import distributions
from msgs_yaml import share
from msgs_yaml.strict_yaml import read

FILE = ('config', 'settings_study.yaml')
LEVELS = ('P0', 'P1', 'P2', 'P3', 'P4')

__all__ = ['FILE', 'LEVELS', 'Plan', 'load', 'rules']


def load() -> Plan:
    """Return the file with its names as attributes: `plan.course.entry_s`.

    `plan.dimensions` holds the distributions of the drawn values by name, in the order of the
    coordinates of a drawn point.
    """
    path = share.path('experiments', *FILE)
    plan = rules(path.read_text(encoding='utf-8'))
    drawn = read(path).items()['dimensions'].items()
    plan.dimensions = {name: distributions.parse(item) for name, item in drawn.items()}
    return plan


def rules(text: str) -> Plan:
    """Return all but the dimensions of the file's text, which kept rows have in their metadata."""
    content = {name: value for name, value in yaml.safe_load(text).items() if name != 'dimensions'}
    return json.loads(json.dumps(content), object_hook=lambda values: Plan(**values))
