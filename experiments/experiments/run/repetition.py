"""Whether a run repeats an older one: the same inputs and program, so the same recording."""

import json
from pathlib import Path

from node_runtime.provenance import DIRTY

# parameters that differ between any two runs: where the recorder writes
PER_RUN = ('out', 'run_info')


def is_repetition(new: Path, old: Path) -> bool:
    """Return whether two files of run information say that both runs have the same bag.

    Only in lockstep, and only where a commit tells which program ran: with uncommitted changes, or
    outside of a repository, nothing does.
    """
    try:
        infos = [json.loads(file.read_text()) for file in (new, old)]
        ours, theirs = map(_without_places, infos)
    except (OSError, ValueError, TypeError, AttributeError):
        return False
    commit = ours.get('git_commit', '')
    is_known = bool(commit) and not commit.endswith(DIRTY)
    return is_known and ours.get('mode') == 'lockstep' and ours == theirs


def _without_places(info):
    nodes = json.loads(info.get('parameters', '{}'))
    for name in PER_RUN:
        nodes.get('recorder', {}).pop(name, None)
    return {**info, 'parameters': nodes}
