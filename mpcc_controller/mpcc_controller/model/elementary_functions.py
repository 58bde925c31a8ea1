"""Elementary functions for numbers and arrays (NumPy) and for CasADi expressions alike."""

import casadi as ca
import numpy as np


def _both(symbolic, numeric):
    def function(x):
        return symbolic(x) if isinstance(x, ca.SX | ca.MX) else numeric(x)

    return function


sin = _both(ca.sin, np.sin)
cos = _both(ca.cos, np.cos)
sqrt = _both(ca.sqrt, np.sqrt)
