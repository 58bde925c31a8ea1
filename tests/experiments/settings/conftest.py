"""The study, and settings of it that are easy to drive."""

import pytest
from drawn_values import VALUES

from experiments.settings import plan as plans
from experiments.settings import plant_variants, setting
from experiments.settings.plant_variants import Variant


@pytest.fixture(scope='session')
def plan():
    """Return ranges, arms and rules of the study."""
    return plans.load()


@pytest.fixture(scope='session')
def plant():
    """Return the plant of VALUES."""
    return plant_variants.build(Variant('bmw_545i.yaml', 0.944, 0.6))


@pytest.fixture(scope='session')
def make_setting(plan):
    """Return make(**changed) -> Setting of VALUES."""

    def make(**changed):
        return setting.build(plan, 0, VALUES | changed)

    return make
