"""What is noted with every run, so that a bag explains itself: parameters, versions, machine."""

import hashlib
import json
import os
import platform
import subprocess
from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from msgs_yaml import share

VERSIONS = {
    'casadi': 'casadi',
    'fastdds': 'ros-fastrtps',
    'mcap': 'mcap',
    'numpy': 'numpy',
    'rclpy': 'rclpy',
    'rmw_fastrtps': 'ros-rmw-fastrtps-cpp',
    'scipy': 'scipy',
}
PACKAGES = (
    'bags',
    'experiments',
    'mpcc_controller',
    'msgs_yaml',
    'node_runtime',
    'scenario_publisher',
    'stage_solver',
    'vehicle_plant',
)
# tracked, written by commands of this project while they measure
RESULTS = ('paper', 'README.md', 'docs', 'bags/reference')
UNKNOWN = 'unknown'
GIT_S = 5.0


def of(
    scenario: str, text: str, controller: str, mode: str, parameters: Mapping[str, Mapping]
) -> dict[str, str]:
    """Return the notes of a run, each a text; structured ones are JSON.

    `parameters` holds the dotted parameters of every node by its role, `text` is the scenario file.
    """
    return {
        'scenario': scenario,
        'scenario_text': text,
        'scenario_sha256': digest(text),
        'controller': controller,
        'parameters': json.dumps(parameters, sort_keys=True),
        **surroundings(mode),
    }


def surroundings(mode: str) -> dict[str, str]:
    """Return what is known of every recording, whoever started the nodes."""
    return {
        'mode': mode,
        'versions': json.dumps(versions(), sort_keys=True),
        'machine': json.dumps(machine(), sort_keys=True),
        'git_commit': commit(),
    }


def digest(text: str) -> str:
    """Return the SHA-256 of a scenario text: runs with equal ones drove the same scenario."""
    return hashlib.sha256(text.encode()).hexdigest()


def versions() -> dict[str, str]:
    """Return the version of everything that a run's numbers may depend on.

    Our solver is part of mpcc_controller; the others come with casadi.
    """
    return {
        'python': platform.python_version(),
        **{name: _version(distribution) for name, distribution in VERSIONS.items()},
        **{package: _package_version(package) for package in PACKAGES},
    }


def _package_version(package):
    try:
        manifest = share.path(package, 'package.xml')
    except FileNotFoundError:
        return UNKNOWN
    return ElementTree.parse(manifest).findtext('version', UNKNOWN)


def _version(distribution):
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return UNKNOWN


def machine() -> dict[str, Any]:
    """Return what the run was computed on."""
    return {
        'processor': _processor(),
        'architecture': platform.machine(),
        'cores': len(os.sched_getaffinity(0)),
        'kernel': platform.release().partition('-')[0],  # what follows names who built it
        'libc': ' '.join(platform.libc_ver()),
    }


def _processor():
    lines = Path('/proc/cpuinfo').read_text().splitlines()
    models = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return models[0] if models else platform.processor()


def commit() -> str:
    """Return the commit of the working tree this code lies in, '' outside of one.

    `-dirty` follows it where a tracked file was changed, but for results and pages: they change
    while they are made.
    """
    here = Path(__file__).parent
    root = _git(here, 'rev-parse', '--show-toplevel')
    # an installation may lie inside somebody else's repository
    if not root or not Path(root, 'bags', 'package.xml').is_file():
        return ''
    head = _git(here, 'rev-parse', 'HEAD')
    besides = [f':(top,exclude){folder}' for folder in RESULTS]
    changed = _git(here, 'status', '--porcelain', '--untracked-files=no', '--', ':(top)', *besides)
    if not head or changed is None:
        return ''
    return head + ('-dirty' if changed else '')


def _git(folder, *arguments):
    try:
        done = subprocess.run(
            ['git', '-C', folder, *arguments], capture_output=True, text=True, timeout=GIT_S
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None
