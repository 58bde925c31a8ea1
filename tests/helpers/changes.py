"""Which files differ from the commit in CHANGED_SINCE, whose tests are taken as passed.

`make check` sets it: tests with the mark `reads` run there when a file that they read is one.
"""

import os
import subprocess
from collections.abc import Iterable
from fnmatch import fnmatch
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
VARIABLE = 'CHANGED_SINCE'


def any_changed(patterns: Iterable[str]) -> bool:
    """Return whether a file that a pattern of `fnmatch` names is new, changed or gone.

    True where nothing is known: the variable is not set, or this clone lacks the commit.
    """
    files = _changed(ROOT, os.environ.get(VARIABLE))
    return files is None or any(fnmatch(file, pattern) for file in files for pattern in patterns)


@cache
def _changed(root, since):
    if not since:
        return None
    lists = (
        ['diff', '--name-only', '--no-renames', since, '--'],
        ['ls-files', '--others', '--exclude-standard'],
    )
    git = ['git', '-C', root]
    try:
        return [
            name
            for words in lists
            for name in subprocess.check_output(
                [*git, *words], stderr=subprocess.DEVNULL, text=True, timeout=60
            ).splitlines()
        ]
    except (OSError, subprocess.SubprocessError):
        return None
