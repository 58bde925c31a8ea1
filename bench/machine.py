"""Description of the machine, its processor times, and pinning to one core."""

import os
import platform
import subprocess
from pathlib import Path
from typing import NamedTuple

from node_runtime import provenance
from stage_solver import compile_cache

GOVERNOR = Path('/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor')
TIMES = Path('/proc/stat')
IDLE, WAITING, STOLEN, GUESTS = 3, 4, 7, 8  # columns of TIMES
UNKNOWN = 'not readable'


class CpuTimes(NamedTuple):
    """Times of all processors, since the start or between two samples."""

    busy_s: float  # used by processes of this machine
    stolen_s: float  # requested by this virtual machine, used by others on its host

    def since(self, before: 'CpuTimes') -> 'CpuTimes':
        """Return the times since an earlier sample."""
        return CpuTimes(*(now - then for now, then in zip(self, before)))


def cpu_times() -> CpuTimes | None:
    """Return the times since the start, None where they are not readable."""
    fields = _text(TIMES).partition('\n')[0].split()[1:]
    if len(fields) < GUESTS:
        return None
    seconds = [int(field) / os.sysconf('SC_CLK_TCK') for field in fields[:GUESTS]]
    idle_s = seconds[IDLE] + seconds[WAITING]
    return CpuTimes(sum(seconds) - idle_s - seconds[STOLEN], seconds[STOLEN])


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
    versions = provenance.versions()
    return {
        'cpu': _cpu(),
        'cores': os.cpu_count() or 0,
        'governor': _text(GOVERNOR).strip() or UNKNOWN,
        'load': f'{os.getloadavg()[0]:.1f}',
        'system': f'{platform.system()} {provenance.machine()["kernel"]}',
        'compiler': _compiler(),
        **{name: versions[name] for name in ('python', 'casadi', 'numpy')},
    }


def _cpu():
    flags = _text(Path('/proc/cpuinfo'))
    widest = next((name for name in ('avx512f', 'avx2', 'sse2') if name in flags), UNKNOWN)
    return f'{provenance.machine()["processor"]} ({widest})'


def _compiler():
    command = compile_cache.find_compiler()
    if command is None:
        return 'none'
    shown = [*command.split(), '--version']
    result = subprocess.run(shown, capture_output=True, text=True, check=False, timeout=60)
    return (result.stdout.splitlines() or [UNKNOWN])[0]


def _text(path):
    try:
        return path.read_text()
    except OSError:
        return ''
