import pytest

from bags.errors import BagError
from experiments.tuning import space


def test_both_controllers_search_the_same_ranges_but_for_one_term_each():
    mpcc, frenet = (space.wide(space.untuned(name)) for name in ('mpcc', 'frenet'))
    common = set(mpcc) & set(frenet)
    assert common == set(space.COMMON)
    assert all(mpcc[name] == frenet[name] for name in common)
    assert set(mpcc) - common == {'tolerances.lag_m'}
    assert set(frenet) - common == {'tolerances.heading_rad'}


def test_the_first_stage_is_as_wide_below_the_untuned_weight_as_above():
    for name, span in space.wide({'a': 0.5, 'b': 2e4}).items():
        centre = {'a': 0.5, 'b': 2e4}[name]
        assert span.high / centre == pytest.approx(centre / span.low)


def test_the_second_stage_is_narrower_and_holds_the_best_of_the_first():
    wide = space.wide({'inner': 1.0, 'rim': 1.0})
    best = {'inner': 2.0, 'rim': wide['rim'].high}
    narrow = space.narrow(wide, best)
    assert narrow['inner'].decades == pytest.approx(wide['inner'].decades / space.NARROWING)
    assert narrow['rim'].high == wide['rim'].high
    assert all(narrow[name].low <= best[name] <= narrow[name].high for name in best)


def test_a_weight_of_zero_cannot_be_searched_for():
    with pytest.raises(BagError, match=r'priorities\.obstacle is 0'):
        space.untuned('mpcc_no_ca')
