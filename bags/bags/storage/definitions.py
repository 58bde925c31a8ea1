"""What a bag says about a message type: its full definition text and its type hash.

Both come from the message packages that are installed (share/<package>/msg). The text is put
together in the order of rosbag2's own source of definitions: the message, then every type it
needs, depth first, sorted by name, each once, under a line of 80 equal signs.
"""

import json
import re

from msgs_yaml import share

PRIMITIVES = frozenset(
    (
        *('bool', 'byte', 'char', 'float32', 'float64', 'string', 'wstring'),
        *('int8', 'uint8', 'int16', 'uint16', 'int32', 'uint32', 'int64', 'uint64'),
    )
)
SEPARATOR = '=' * 80


def split(type_name: str) -> tuple[str, str]:
    """Package and message name of 'package/msg/Name' or 'package/Name'."""
    package, *_, name = type_name.split('/')
    return package, name


def schema_text(type_name: str) -> str:
    """Return the definition of `type_name` ('package/msg/Name') with all it depends on.

    Raises FileNotFoundError, naming the places searched, when a package is not installed.
    """
    return _expand(*split(type_name), seen=set())


def type_hash(type_name: str) -> str:
    """Return the hash of REP 2011 ('RIHS01_...') that the generator of messages computed.

    Raises FileNotFoundError when the package is not installed.
    """
    package, name = split(type_name)
    path = share.path(package, 'msg', f'{name}.json')
    hashes = json.loads(path.read_text(encoding='utf-8'))['type_hashes']
    return {entry['type_name']: entry['hash_string'] for entry in hashes}[type_name]


def _expand(package, name, seen):
    text = share.path(package, 'msg', f'{name}.msg').read_text(encoding='utf-8')
    parts = [text]
    for dependency in _dependencies(text, package):
        if dependency not in seen:
            seen.add(dependency)
            parts += [f'\n{SEPARATOR}\nMSG: {dependency}\n', _expand(*split(dependency), seen)]
    return ''.join(parts)


def _dependencies(text, package):
    """Sorted 'package/Name' of every type used that is no primitive."""
    found = set()
    for line in text.splitlines():
        code = line.partition('#')[0].split()
        if not code:
            continue
        base = re.split(r'<=|\[', code[0])[0]
        if base not in PRIMITIVES:
            found.add(base if '/' in base else f'{package}/{base}')
    return sorted(found)
