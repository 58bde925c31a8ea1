from dataclasses import replace

import drives
import numpy as np
import pytest


@pytest.fixture(scope='session')
def params():
    return drives.load()


@pytest.fixture(scope='session')
def bare(params):
    """The published tyre: every scaling factor one."""
    ones = dict.fromkeys(vars(params.car.scaling.front), 1.0)
    return replace(params.car.scaling.front, **ones)


@pytest.fixture
def rng():
    return np.random.default_rng(20240501)
