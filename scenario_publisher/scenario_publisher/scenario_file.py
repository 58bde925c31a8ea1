"""Text and YAML nodes of a scenario file, with limits on size, depth and aliases."""

import re
from pathlib import Path

import yaml

from msgs_yaml.strict_yaml import Item, YamlError

MAX_BYTES = 8_000_000
MAX_DEPTH = 32
# libyaml parses a hundred times faster than Python, but is not everywhere
LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_KEY_PART = re.compile(r'\[(\d+)\]|([^.\[\]]+)')


class ScenarioError(YamlError):
    """A scenario that cannot be used; the text names file, line, dotted key and what is allowed.

    check   what of `scenario.CHECKS` did not hold, '' before any of them
    """

    check = ''


class KeyedError(Exception):
    """A mistake beyond the schema: a dotted key of the file, and what is wrong with its value.

    check   what of `scenario.CHECKS` does not hold
    """

    check = ''


def read(path: Path) -> str:
    """Return the text of a file. Raises ScenarioError when it is unreadable, too long or binary."""
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise ScenarioError(f'{path}: has {size} bytes; allowed at most {MAX_BYTES} bytes')
        return path.read_text(encoding='utf-8')
    except OSError as error:
        raise ScenarioError(f'{path}: {error.strerror or error}') from None
    except UnicodeDecodeError as error:
        raise ScenarioError(f'{path}: is no UTF-8 text: {error.reason}') from None


def parse_yaml(text: str, source: str) -> Item:
    """Return the root node of a YAML text; `source` is the file name that errors show.

    Raises ScenarioError when the text is no YAML, is empty, nests too deeply or uses aliases (with
    them a short file can expand to gigabytes).
    """
    try:
        _check_depth_and_aliases(text, source)
        node = yaml.compose(text, Loader=LOADER)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        raise ScenarioError(f'{source}:{line}: no valid YAML: {error.problem}') from None
    except (yaml.YAMLError, UnicodeError) as error:
        raise ScenarioError(f'{source}: no valid YAML: {error}') from None
    if node is None:
        raise ScenarioError(f'{source}: is empty')
    return Item(Path(source), '', node)


def _check_depth_and_aliases(text, source):
    # the parser's events are flat; composing them recurses and could exhaust the stack
    depth = 0
    for event in yaml.parse(text, Loader=LOADER):
        line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):
            raise ScenarioError(f'{source}:{line}: aliases (*{event.anchor}) are not allowed')
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            raise ScenarioError(f'{source}:{line}: nests deeper than {MAX_DEPTH} levels')


def error_at(root: Item, key: str, what: str) -> ScenarioError:
    """Return the error about a dotted key such as `obstacles[1].x_m`, with its line.

    A key missing from the file gets the line of the block that would contain it.
    """
    item = root
    for index, name in _KEY_PART.findall(key):
        children = item.elements() if index else item.items()
        try:
            item = children[int(index) if index else name]
        except (KeyError, IndexError):
            break
    return ScenarioError(str(item._replace(key=key).error(what)))
