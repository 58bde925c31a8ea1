"""Tables in Markdown, as a terminal and a page show them; and the machine where they are made."""

import os
import platform
import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import psutil

from node_runtime import provenance
from stage_solver import compile_cache

GOVERNOR = Path('/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor')
UNKNOWN = 'not readable'


def markdown(title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table; its first column is left-aligned, the others right-aligned."""
    rule = ['---'] + ['---:'] * (len(columns) - 1)
    lines = [f'| {" | ".join(map(str, row))} |' for row in (columns, rule, *rows)]
    return '\n'.join([f'## {title}', '', *lines, ''])


def number(value: float) -> str:
    """Return a time or a ratio with three significant digits, a dash for NaN."""
    if value != value:
        return '-'
    digits = 0 if value >= 100 else 1 if value >= 10 else 2 if value >= 1 else 3
    return f'{value:.{digits}f}'


def share(value: float) -> str:
    """Return a rate in per cent; 100 % only where it is all."""
    return '100 %' if value == 1 else f'{min(100 * value, 99.9):.1f} %'


def cpu_times() -> np.ndarray:
    """Return the times [s] since the start that all processors were busy, and that were stolen.

    Stolen: requested by this virtual machine, and used by others on its host.
    """
    now = psutil.cpu_times()
    busy = now.user + now.nice + now.system + now.irq + now.softirq
    return np.array([busy, getattr(now, 'steal', 0.0)])


def pin() -> str:
    """Stay on one core from now on; return which one, or why not."""
    try:
        core = max(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {core})
    except (AttributeError, OSError) as error:
        return f'not pinned ({error})'
    return f'core {core}'


def machine() -> dict[str, str | int]:
    """Return what decides how fast this machine is."""
    versions, flags = provenance.versions(), _text(Path('/proc/cpuinfo'))
    widest = next((name for name in ('avx512f', 'avx2', 'sse2') if name in flags), UNKNOWN)
    command = compile_cache.find_compiler()
    compiler = ['none']
    if command is not None:
        shown = [*command.split(), '--version']
        result = subprocess.run(shown, capture_output=True, text=True, check=False, timeout=60)
        compiler = result.stdout.splitlines() or [UNKNOWN]
    return {
        'cpu': f'{provenance.machine()["processor"]} ({widest})',
        'cores': os.cpu_count() or 0,
        'governor': _text(GOVERNOR).strip() or UNKNOWN,
        'load': f'{os.getloadavg()[0]:.1f}',
        'system': f'{platform.system()} {provenance.machine()["kernel"]}',
        'compiler': compiler[0],
        **{name: versions[name] for name in ('python', 'casadi', 'numpy')},
    }


def _text(path):
    try:
        return path.read_text()
    except OSError:
        return ''
