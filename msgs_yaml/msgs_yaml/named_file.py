"""A file that a parameter or an option names: found, or refused with the name of what names it."""

from collections.abc import Mapping
from pathlib import Path

from msgs_yaml import share
from msgs_yaml.overrides import NO_SOURCES
from msgs_yaml.parameters import ParameterError


def find(
    package: str, parameter: str, name: str, holds: str, sources: Mapping[str, str] = NO_SOURCES
) -> Path:
    """Return the path of a file that `parameter` names; `share.config` has the rest.

    Raises ParameterError `<source>: <parameter>: <what>`, with a source where `sources` knows it.
    """
    try:
        return share.config(package, name, holds)
    except FileNotFoundError as error:
        source = f'{sources[parameter]}: ' if parameter in sources else ''
        raise ParameterError(f'{source}{parameter}: {error}') from None
