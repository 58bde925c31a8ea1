"""A scenario file as YAML nodes that know their line, refused early when it is absurd.

`msgs_yaml.strict_yaml.Item` names file, line and dotted key of every value.
"""

import re
from pathlib import Path

import yaml

from msgs_yaml.strict_yaml import Item, YamlError

MAX_BYTES = 8_000_000
MAX_DEPTH = 32
# libyaml parses a hundred times faster than Python, but is not everywhere
LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_STEP = re.compile(r'\[(\d+)\]|([^.\[\]]+)')


class ScenarioError(YamlError):
    """A scenario that cannot be used; the text names file, line, dotted key and what is allowed."""


def read(path: Path) -> str:
    """Return the text of a file; raise ScenarioError when it is unreadable, too long or no text."""
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise ScenarioError(f'{path}: has {size} bytes; allowed at most {MAX_BYTES} bytes')
        return path.read_text(encoding='utf-8')
    except OSError as error:
        raise ScenarioError(f'{path}: {error.strerror or error}') from None
    except UnicodeDecodeError as error:
        raise ScenarioError(f'{path}: is no UTF-8 text: {error.reason}') from None


def parse(text: str, source: str) -> Item:
    """Return the root of a YAML text; `source` is the file name that errors show.

    Raises ScenarioError for what is no YAML, is empty, nests too deeply or uses aliases (with
    them a short file can stand for gigabytes).
    """
    try:
        _refuse_depth_and_aliases(text, source)
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


def _refuse_depth_and_aliases(text, source):
    # the parser's events are flat; composing them recurses and could end in a crash
    depth = 0
    for event in yaml.parse(text, Loader=LOADER):
        if isinstance(event, yaml.AliasEvent):
            line = event.start_mark.line + 1
            raise ScenarioError(f'{source}:{line}: aliases (*{event.anchor}) are not allowed')
        depth += isinstance(event, yaml.CollectionStartEvent)
        depth -= isinstance(event, yaml.CollectionEndEvent)
        if depth > MAX_DEPTH:
            line = event.start_mark.line + 1
            raise ScenarioError(f'{source}:{line}: nests deeper than {MAX_DEPTH} levels')


def error_at(root: Item, key: str, what: str) -> ScenarioError:
    """Return the error about a dotted key such as `obstacles[1].x_m`, with the line it stands in.

    A key that the file leaves out gets the line of what would contain it.
    """
    item = root
    for index, name in _STEP.findall(key):
        children = item.elements() if index else item.items()
        try:
            item = children[int(index) if index else name]
        except (KeyError, IndexError):
            break
    return ScenarioError(str(item._replace(key=key).error(what)))
