"""Elementary functions for numbers and arrays (NumPy) and for CasADi expressions alike."""

import casadi as ca
import numpy as np


def _both(of_expression, of_number):
    def function(x):
        return of_expression(x) if isinstance(x, ca.SX | ca.MX) else of_number(x)

    return function


sin = _both(ca.sin, np.sin)
cos = _both(ca.cos, np.cos)
sqrt = _both(ca.sqrt, np.sqrt)
