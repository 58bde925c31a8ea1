"""The compiled solver of a problem as a Python object: one workspace, one C call per solve."""

import ctypes
from functools import cache
from pathlib import Path

import numpy as np

DOUBLES = (
    'x0', 'P', 'x_low', 'x_high', 'u_low', 'u_high', 'g_low', 'g_high', 'h_low', 'h_high',
    'X', 'U', 'm_x', 'm_u', 'm_dynamics', 'm_g', 'm_h',
)  # fmt: skip
SETTINGS = ('tolerance', 'time_limit', 'warm_mu', 'step_residual', 'step_decrease')
RESULTS = ('cost', 'primal_residual', 'dual_residual')
SWITCHES = ('warm', 'max_iterations')
COUNTS = ('status', 'iterations', 'trials', 'factorisations')
ALIGNMENT = 64  # bytes of the widest vector


class Call(ctypes.Structure):
    """As in riccati_c/workspace.h."""

    _fields_ = (
        [(name, ctypes.c_void_p) for name in DOUBLES]
        + [(name, ctypes.c_double) for name in SETTINGS + RESULTS]
        + [(name, ctypes.c_longlong) for name in SWITCHES + COUNTS]
    )


class Instance:
    """A workspace and the arrays that C reads and writes; not to be used by two threads at once."""

    def __init__(self, library: Path, shapes: dict[str, tuple[int, ...]]):
        self._solve, size = _load(library)
        self._memory = np.zeros(size + ALIGNMENT, np.uint8)
        start = self._memory.ctypes.data
        self._workspace = start + -start % ALIGNMENT
        self.arrays = {name: np.zeros(shapes[name]) for name in DOUBLES}
        self.call = Call(**{name: a.ctypes.data for name, a in self.arrays.items()})
        self._call = ctypes.addressof(self.call)

    def solve(self) -> None:
        """Run C on `arrays` and `call`; Python's lock is free meanwhile."""
        self._solve(self._workspace, self._call)


@cache
def _load(library):
    loaded = ctypes.CDLL(str(library))
    loaded.riccati_bytes.restype = loaded.riccati_call_bytes.restype = ctypes.c_size_t
    if loaded.riccati_call_bytes() != ctypes.sizeof(Call):
        raise OSError(f'{library} was made for another layout of its arguments')
    loaded.riccati_solve.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
    loaded.riccati_solve.restype = None
    return loaded.riccati_solve, loaded.riccati_bytes()
