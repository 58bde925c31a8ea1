"""A Python function on symbols is the function on numbers, branch by branch."""

import math

import casadi as ca
import numpy as np
import pytest

from vehicle_plant.multi_body import symbolic

HERE = __name__.partition('.')[0]


def saturate(x, limits):
    if x <= limits[0] and x <= 0:
        x = limits[0]
    elif x >= limits[1] or x > 100:
        x = limits[1]
    return x


def sign(x):
    if x > 0:
        return 1
    if x < 0:
        return -1
    return 0


def worked(x, y, half):
    """Branches, a loop, lists that grow and change, a call, a division by zero in one branch."""
    u = []
    u.append(saturate(x, [-1.0, 2.0]))
    if abs(y) < 0.1:
        slip = 0.0
        f = [u[0]]
    else:
        slip = math.atan(1 / y)
        f = [-u[0]]
    v = [x, y]
    for i in range(2):
        if v[i] < 0.0:
            v[i] = 0.0
            f.append(half)
        else:
            f.append(i)
    if half:
        f.append(sign(y) * slip)
    return f + v


def on_symbols(half):
    x, y = ca.SX.sym('x'), ca.SX.sym('y')
    result, _ = symbolic.evaluate(worked, (x, y, half), (HERE,))
    return ca.Function('f', [x, y], [ca.vertcat(*result)])


@pytest.mark.parametrize('half', [0.5, 0.0])
def test_it_has_the_values_of_the_function(half):
    f = on_symbols(half)
    for x in (-3.0, -1.0, -0.5, 0.0, 1.0, 2.0, 2.5):
        for y in (-2.0, -0.1, -0.05, 0.0, 0.05, 0.1, 3.0, 200.0):
            expected = worked(x, y, half)
            np.testing.assert_allclose(np.asarray(f(x, y)).ravel(), expected, rtol=1e-15)


def test_a_function_that_may_return_nothing_is_refused():
    def may_return_nothing(x):  # noqa: RET503
        if x > 0:
            return 1

    with pytest.raises(ValueError, match='one branch returns, the other one does not'):
        symbolic.evaluate(may_return_nothing, (ca.SX.sym('x'),), ())
