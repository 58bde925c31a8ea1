"""What was fixed before the study was driven: preconditions, claims and rules of decision."""

import json
from types import SimpleNamespace as Plan

import yaml

LEVELS = ('P0', 'P1', 'P2', 'P3', 'P4')

__all__ = ['LEVELS', 'Plan', 'rules']


def rules(text: str) -> Plan:
    """Return the preregistration with its names as attributes: `rules.decision.holds_from`.

    `text` is that of paper/settings/settings_study.yaml, which kept rows have in their metadata.
    """
    content = yaml.safe_load(text)
    return json.loads(json.dumps(content), object_hook=lambda values: Plan(**values))
