"""The version of the code that decides a drive: a digest of sources, libraries and processor."""

import hashlib
import json
from functools import cache
from importlib import util
from pathlib import Path

from bags.experiments import notes

CORES = ('msgs_yaml', 'scenario_publisher', 'vehicle_plant', 'mpcc_controller')
SOURCES = ('.py', '.c', '.h')
# of this package: the ring in process, and what judges a drive
OURS = (
    'closed_loop/ring.py',
    'experiments/simulated.py',
    'storage/columns.py',
    'study/case.py',
    'study/measure.py',
    'units.py',
    'verdict/answers.py',
    'verdict/drive.py',
    'verdict/geometry.py',
    'verdict/handling.py',
    'verdict/judge.py',
    'verdict/metrics.py',
    'verdict/recorded.py',
)


@cache
def digest() -> str:
    """Return the SHA-256 of all of it; times of the solver belong to the machine, too."""
    found = hashlib.sha256()
    for root in map(_root, CORES):
        for path in sorted(root.rglob('*')):
            if path.suffix in SOURCES and not path.stem.endswith('_node'):
                _add(found, path.relative_to(root.parent), path)
    for name in OURS:
        _add(found, name, _root('bags') / name)
    versions, machine = notes.versions(), notes.machine()
    kept = [versions[name] for name in ('casadi', 'numpy')] + [machine['processor']]
    found.update(json.dumps(kept).encode())
    return found.hexdigest()


def _root(package):
    return Path(util.find_spec(package).origin).parent


def _add(found, name, path):
    found.update(f'{name}\0'.encode() + path.read_bytes() + b'\0')
