"""What a figure tells: every run in its own look, units, legends, limits that hide nothing."""

import itertools

import numpy as np
import pytest
from evaluated_drives import evaluate_runs
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from straight_drive import drive_of, obstacle, straight_scene

from bags.figures import comparison_figures, style
from bags.report import page


@pytest.fixture(scope='module')
def runs():
    """Return three runs past an obstacle that stands and one that moves."""
    scene = straight_scene((obstacle(1, 60.0, -3.5), obstacle(2, 20.0, 4.0, vx=5.0, radius=0.5)))
    return evaluate_runs(
        {name: drive_of(scene=scene, controller=name) for name in ('mpcc', 'mpcc_no_ca', 'own')}
    )


def trajectories(runs):
    axes = Figure().add_subplot()
    comparison_figures.draw_trajectories(axes, runs)
    return axes


def test_a_figure_shows_every_run_in_its_own_colour_and_has_units(runs):
    colours = {run.look.colour for run in runs}
    assert len(colours) == len(runs)
    for name, panel in comparison_figures.FIGURES.items():
        axes = Figure().add_subplot()
        panel(axes, runs)
        assert {line.get_color() for line in axes.get_lines()} >= colours, name
        assert '[' in axes.get_xlabel()
        assert '[' in axes.get_ylabel()


def test_of_an_object_of_several_discs_all_are_drawn_and_one_has_the_times():
    front = obstacle(2, 20.0, 4.0, vx=5.0)
    discs = (front, front._replace(x=front.x - 2.7, disc=1))
    one, both = (
        trajectories(evaluate_runs({'mpcc': drive_of(scene=straight_scene(scene))}))
        for scene in ((front,), discs)
    )
    assert [text.get_text() for text in both.texts] == [text.get_text() for text in one.texts]
    circles = [sum(isinstance(p, Circle) for p in axes.patches) for axes in (one, both)]
    assert circles[1] == 2 * circles[0] > 0


AREAS = ['within the safety distance', 'circles overlap']


@pytest.mark.parametrize(
    ('name', 'marks'),
    [('trajectories', ['coarse path', *AREAS]), ('v2o', AREAS), ('sideslip', [])],
)
def test_a_legend_lists_what_its_panel_shows(runs, name, marks):
    (legend,) = comparison_figures.draw_figure(name, runs, '').legends
    assert [text.get_text() for text in legend.get_texts()] == [run.name for run in runs] + marks


def test_whole_cars_and_obstacles_are_in_view_and_what_moves_has_times(runs):
    axes = trajectories(runs)
    assert axes.get_xlim()[0] < -runs[0].drive.facts.outline.rear
    assert {'0.0 s', '1.2 s', '2.4 s'} <= {text.get_text() for text in axes.texts}
    still = trajectories(evaluate_runs({'mpcc': drive_of()}))
    assert not [text for text in still.texts if text.get_gid() == style.TIME_LABEL]
    for y, is_seen in ((-6.0, True), (-40.0, False)):
        scene = straight_scene([obstacle(1, 60.0, y, radius=3.0)])
        low, _ = comparison_figures.road_limits(evaluate_runs({'mpcc': drive_of(scene=scene)}))
        assert (low[1] <= y - 3.0) == is_seen


@pytest.mark.parametrize(
    ('crowd', 'titles'),
    [
        ([obstacle(1, 50.0, 2.5)], ['obstacle 1']),
        ([obstacle(1, 50.0, 2.1 + comparison_figures.NEAR_M + 0.1)], []),
        ([obstacle(1, 30.0, 2.5), obstacle(2, 70.0, 2.5)], ['obstacle 1', 'obstacle 2']),
        ([obstacle(k, 5.0 + 15.0 * k, 2.5) for k in range(7)], []),  # no room beside it
    ],
)
def test_closest_approaches_are_enlarged_where_there_is_room(crowd, titles):
    ax = Figure().add_subplot()
    comparison_figures.FIGURES['v2o'](
        ax, evaluate_runs({'mpcc': drive_of(scene=straight_scene(crowd))})
    )
    assert sorted(inner.get_title() for inner in ax.child_axes) == titles
    spans = sorted(a.get_position(original=True).intervalx.tolist() for a in ax.child_axes)
    assert all(before[1] < after[0] for before, after in itertools.pairwise(spans))
    for inner in ax.child_axes:
        drawn = inner.get_lines()[0].get_ydata()
        # circles of 1.1 m and 1.0 m, 2.5 m apart
        assert drawn.min() == pytest.approx(0.4, abs=1e-6)
        assert drawn.max() < comparison_figures.NEAR_M


def test_a_panel_of_obstacles_without_any_says_so():
    axes = Figure().add_subplot()
    comparison_figures.FIGURES['v2o'](axes, evaluate_runs({'mpcc': drive_of()}))
    assert 'no obstacle within 5 m' in {text.get_text() for text in axes.texts}


def test_an_axis_is_not_filled_by_noise_and_holds_every_value(runs):
    noise = 20.0 + 0.01 * np.sin(np.arange(100.0))
    low, high = comparison_figures.axis_limits(5.0, [noise])
    assert high - low == pytest.approx(5.0)
    low, high = comparison_figures.axis_limits(5.0, [noise, np.array([3.0, np.nan, 31.0])])
    assert low < 3.0 < 31.0 < high
    assert comparison_figures.axis_limits(2.0, [np.full(3, np.nan)]) == (-1.0, 1.0)
    gg = Figure().add_subplot()
    comparison_figures.draw_gg(gg, runs)
    assert gg.get_xlim() == gg.get_ylim()


# looks


def test_a_controller_keeps_its_colour_whoever_else_is_shown():
    known = style.KNOWN
    for names in (['mpcc', 'frenet'], ['own', 'frenet', 'mpcc'], ['frenet', 'own']):
        colours = style.assign_colours(names)
        assert colours['frenet'] == known['frenet']
        assert colours.get('mpcc', known['mpcc']) == known['mpcc']
        assert colours.get('own') not in known.values()
    many = [f'own_{k}' for k in range(12)]
    assert list(style.assign_colours(many)) == many


def test_curves_that_coincide_stay_visible_and_every_run_has_a_dash_of_its_own():
    looks = style.assign_looks(['mpcc', 'mpcc_no_ca', 'frenet', 'own', 'another'])
    widths = [look.width for look in looks.values()]
    assert widths == sorted(set(widths), reverse=True)
    assert len({look.dash for look in looks.values()}) == len(looks)
    # what is drawn over a solid line has gaps that show it
    assert looks['mpcc'].dash == style.SOLID


def test_many_runs_of_a_controller_share_a_colour_and_a_line_of_the_legend():
    controllers = ['mpcc', 'frenet', 'own'] * 10
    names = [f'{name}@{k}' for k, name in enumerate(controllers)]
    looks = style.assign_looks(names, controllers)
    assert len({look.colour for look in looks.values()}) == 3
    assert looks['mpcc@0'].colour == style.KNOWN['mpcc']
    assert {look.width for look in looks.values()} == {style.MANY_WIDTH}
    wanted = ['mpcc: 10 runs', 'frenet: 10 runs', 'own: 10 runs']
    runs = evaluate_runs({name: drive_of(controller=name) for name in names})
    assert list(style.legend_looks(runs)) == wanted
    # so many controllers have no colours that are told apart
    others = evaluate_runs({f'own_{k}': drive_of(controller=f'own_{k}') for k in range(30)})
    assert list(style.legend_looks(others)) == ['30 runs']
    assert style.legend_looks(runs[:3]) == {run.name: run.look for run in runs[:3]}


# of the page


@given(
    arrays.arrays(
        float, st.integers(1, 400), elements=st.one_of(st.floats(-1e6, 1e6), st.just(np.nan))
    ),
    st.integers(1, 40),
)
def test_thinning_keeps_extremes_gaps_ends_and_order(values, bins):
    kept = page.decimate(values, bins)
    assert np.all(np.diff(kept) > 0)
    assert (kept[0], kept[-1]) == (0, len(values) - 1)
    assert len(kept) <= 3 * bins + 2
    bounds = np.linspace(0, len(values), bins + 1).astype(int)
    for first, after in itertools.pairwise(bounds):
        inside, stretch = values[kept[(kept >= first) & (kept < after)]], values[first:after]
        assert np.isnan(stretch).any() == np.isnan(inside).any()
        if not np.isnan(stretch).all():
            assert (np.nanmin(inside), np.nanmax(inside)) == (
                np.nanmin(stretch),
                np.nanmax(stretch),
            )
