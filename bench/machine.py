"""Which machine the figures are of, and a core of its own to work on."""

import os
import platform
import subprocess
from pathlib import Path

import casadi as ca
import numpy as np

from msgs_yaml import compiled

GOVERNOR = Path('/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor')
UNKNOWN = 'not readable'


def pin() -> str:
    """Stay on one core from now on; return which one, or why not."""
    try:
        core = max(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {core})
    except (AttributeError, OSError) as error:
        return f'not pinned ({error})'
    return f'core {core}'


def named() -> dict[str, str | int]:
    """Return what decides how fast this machine is."""
    kernel = platform.release().partition('-')[0]  # what follows names who built it
    return {
        'cpu': _cpu(),
        'cores': os.cpu_count() or 0,
        'governor': _text(GOVERNOR).strip() or UNKNOWN,
        'load': f'{os.getloadavg()[0]:.1f}',
        'system': f'{platform.system()} {kernel}',
        'compiler': _compiler(),
        'python': platform.python_version(),
        'casadi': ca.__version__,
        'numpy': np.__version__,
    }


def _cpu():
    lines = _text(Path('/proc/cpuinfo')).splitlines()
    models = [line.split(':', 1)[1].strip() for line in lines if line.startswith('model name')]
    model = models[0] if models else platform.processor() or platform.machine()
    widest = next((s for s in ('avx512f', 'avx2', 'sse2') if any(s in x for x in lines)), UNKNOWN)
    return f'{model} ({widest})'


def _compiler():
    command = compiled.find_compiler()
    if command is None:
        return 'none'
    shown = [*command.split(), '--version']
    done = subprocess.run(shown, capture_output=True, text=True, check=False, timeout=60)
    return (done.stdout.splitlines() or [UNKNOWN])[0]


def _text(path):
    try:
        return path.read_text()
    except OSError:
        return ''
