"""A seed that changes with every commit and is the same wherever that commit is tested."""

import os
import subprocess
import warnings
from pathlib import Path


def seed(variable: str) -> int:
    """Return the integer in an environment variable; unset, one made from the commit.

    Outside a repository, or without git, it is 0 with a warning. Raises ValueError for a variable
    that is no integer.
    """
    given = os.environ.get(variable)
    if given:
        return int(given)
    try:
        head = subprocess.run(
            ['git', 'rev-parse', 'HEAD'],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=True,
            timeout=30,
        ).stdout.strip()
    except (OSError, subprocess.SubprocessError) as error:
        output = (getattr(error, 'stderr', None) or str(error)).strip()
        warnings.warn(
            f'the seed is 0, whatever the commit; git: {output}; another seed with {variable}=N',
            stacklevel=2,
        )
        return 0
    return int(head[:8], 16)
