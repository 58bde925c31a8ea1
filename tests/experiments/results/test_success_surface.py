"""A fitted surface is near the true share, and says how sure it is."""

import numpy as np
import pytest

from bags.errors import BagError
from experiments.results import success_surface


@pytest.fixture(scope='module')
def points():
    rng = np.random.default_rng(11)
    return rng.uniform(14.0, 30.0, 400), rng.uniform(0.4, 1.0, 400)


@pytest.fixture(scope='module', autouse=True)
def few_resamples():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(success_surface, 'RESAMPLES', 60)
        yield


def test_the_surface_is_near_the_true_share_and_its_interval_has_it(points, true_share):
    x, y = points
    holds = np.random.default_rng(2).random(400) < true_share(x, y)
    surface = success_surface.fit(x, y, holds, range(400))
    truth = true_share(*np.meshgrid(surface.x, surface.y))
    assert surface.skill > 0.3
    assert np.abs(surface.share - truth).max() < 0.2
    assert np.abs(surface.share - truth).mean() < 0.05
    assert np.mean((surface.low <= truth) & (truth <= surface.high)) > 0.75
    assert (surface.low <= surface.high).all()


def test_outcomes_that_do_not_depend_on_the_columns_have_no_skill(points):
    holds = np.random.default_rng(5).random(400) < 0.5
    assert success_surface.fit(*points, holds, range(400)).skill < 0.03


def test_copies_of_drives_do_not_narrow_the_interval(points, true_share):
    x, y = (column[:100] for column in points)
    holds = np.random.default_rng(2).random(100) < true_share(x, y)
    one = success_surface.fit(x, y, holds, range(100))
    many = success_surface.fit(*(np.tile(part, 5) for part in (x, y, holds)), [*range(100)] * 5)
    width, width_many = ((s.high - s.low).mean() for s in (one, many))
    assert width_many > 0.7 * width


@pytest.mark.parametrize('count', [0, 3, 397, 400])
def test_where_nearly_all_agree_there_is_nothing_to_fit(points, count):
    holds = np.arange(400) < count
    with pytest.raises(BagError, match=f'{count} of 400 drives fulfil'):
        success_surface.fit(*points, holds, range(400))


def test_drives_of_one_draw_tell_nothing_of_others(points, true_share):
    x, y = points
    holds = np.random.default_rng(2).random(400) < true_share(x, y)
    with pytest.raises(BagError, match='share one draw or run'):
        success_surface.fit(x, y, holds, [7] * 400)
