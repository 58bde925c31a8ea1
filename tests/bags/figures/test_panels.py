"""The closest approaches are enlarged where the panel has room for them."""

import numpy as np
import pytest

from bags.evaluation.drive import Obstacle
from bags.evaluation.series import compute_series
from bags.figures import comparison_figures, panels, style


def obstacle(number, x, y):
    still = np.zeros(101)
    return Obstacle(number, np.full(101, x), np.full(101, y), still, still, 1.0)


@pytest.fixture
def enlarged(make_drive):
    """Return of(obstacles): the axes that enlarge parts of the panel of a straight drive."""

    def of(*obstacles):
        scene = make_drive().scene._replace(obstacles=obstacles)
        item = make_drive(scene=scene)
        ax = comparison_figures.Figure().add_subplot()
        panels.draw_v2o(ax, [panels.Run('mpcc', item, compute_series(item), '#0072B2')])
        return ax.child_axes

    return of


def test_a_closest_approach_is_enlarged_with_its_unsafe_area(enlarged):
    # circles of 1.1 m and 1.0 m, 2.5 m apart
    (inner,) = enlarged(obstacle(1, 50.0, 2.5))
    assert inner.get_title() == 'obstacle 1'
    drawn = inner.get_lines()[0].get_ydata()
    assert drawn.min() == pytest.approx(0.4, abs=1e-6)
    assert drawn.max() < panels.NEAR_M
    low, high = inner.get_xlim()
    assert low < 50.0 < high
    assert len(inner.patches) == 2


def test_what_stays_far_away_is_not_enlarged(enlarged):
    assert enlarged(obstacle(1, 50.0, 2.1 + panels.NEAR_M + 0.1)) == []


def test_two_approaches_do_not_cover_each_other_or_the_curves(enlarged):
    first, second = enlarged(obstacle(1, 30.0, 2.5), obstacle(2, 70.0, 2.5))
    assert {first.get_title(), second.get_title()} == {'obstacle 1', 'obstacle 2'}
    spans = sorted(item.get_position(original=True).intervalx.tolist() for item in (first, second))
    assert spans[0][1] < spans[1][0]


def test_without_room_beside_it_nothing_is_enlarged(enlarged):
    many = [obstacle(k, 5.0 + 15.0 * k, 2.5) for k in range(7)]
    assert enlarged(*many) == []


def test_a_tuned_controller_looks_like_the_untuned_one_unless_both_are_shown():
    alone = style.assign_colours(['mpcc_tuned', 'frenet'])
    assert alone == {'mpcc_tuned': style.KNOWN['mpcc'], 'frenet': style.KNOWN['frenet']}
    both = style.assign_colours(['mpcc', 'mpcc_tuned'])
    assert both['mpcc'] == style.KNOWN['mpcc'] != both['mpcc_tuned']
    assert style.line_style('mpcc_no_ca_tuned') == style.line_style('mpcc_no_ca') == style.DASHED
