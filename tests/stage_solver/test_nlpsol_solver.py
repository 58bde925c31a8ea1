"""Residuals of the CasADi solvers, judged by ourselves."""

import math

import numpy as np
import pytest

from stage_solver.nlpsol_backend import NlpsolCall
from stage_solver.nlpsol_solver import _max_violation

FREE = np.array([-math.inf]), np.array([math.inf])
CALL = NlpsolCall(np.zeros(1), np.zeros(0), *FREE, np.array([-1.0]), np.array([1.0]))


@pytest.mark.parametrize(('g', 'expected'), [(0.5, 0.0), (1.5, 0.5), (-3.0, 2.0)])
def test_the_max_violation_is_the_distance_to_the_limit(g, expected):
    assert _max_violation(CALL, np.zeros(1), np.array([g])) == pytest.approx(expected)


def test_a_constraint_that_is_not_a_number_is_not_feasible():
    assert math.isnan(_max_violation(CALL, np.zeros(1), np.array([math.nan])))
