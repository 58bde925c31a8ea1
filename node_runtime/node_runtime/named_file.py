"""Parameter files by name or path; an error names the parameter or option that names the file."""

import os
from collections.abc import Mapping
from pathlib import Path

from msgs_yaml import share
from node_runtime import parameters
from node_runtime.overrides import NO_SOURCES
from node_runtime.parameters import ParameterError


def config(package: str, name: str, holds: str = '') -> Path:
    """Return the path of a parameter file: a bare name lies in the package's config/.

    A name with a path separator is a path, relative to the working directory or to the home
    directory (`~`). Raises FileNotFoundError, one line, when there is no such file. It lists the
    files of config/ that have the parameter `holds`, by dotted name, or all without one.
    """
    if os.sep in name:
        # not Path.expanduser, which raises for an unknown user
        given = Path(os.path.expanduser(name))
        if not given.is_file():
            raise FileNotFoundError(f'there is no file {name} (seen from {Path.cwd()})')
        return given
    try:
        found = share.path(package, 'config', name)
    except FileNotFoundError:
        found = None
    if found and found.is_file():
        return found
    files = sorted(share.path(package, 'config').glob('*.yaml'))
    fitting = [one for one in files if not holds or holds in parameters.read_file(one)[0]]
    known = ', '.join(one.name for one in fitting)
    raise FileNotFoundError(
        f'package {package} has no file config/{name}; it has {known}; '
        f'a file elsewhere needs a path, such as .{os.sep}{name}'
    )


def find(
    package: str, parameter: str, name: str, holds: str, sources: Mapping[str, str] = NO_SOURCES
) -> Path:
    """Return the path of a file that `parameter` names; see `config` for names.

    Raises ParameterError `<source>: <parameter>: <what>`, with a source where `sources` knows it.
    """
    try:
        return config(package, name, holds)
    except FileNotFoundError as error:
        source = f'{sources[parameter]}: ' if parameter in sources else ''
        raise ParameterError(f'{source}{parameter}: {error}') from None
