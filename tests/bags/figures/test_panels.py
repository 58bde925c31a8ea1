"""The closest approaches are enlarged where the panel has room for them."""

import numpy as np
import pytest
from evaluated_drives import evaluate_runs
from matplotlib.backends.backend_agg import FigureCanvasAgg

from bags.evaluation.drive import Obstacle
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
        panels.draw_v2o(ax, evaluate_runs({'mpcc': item}))
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
    tuned, plain = (style.assign_looks([name]) for name in ('mpcc_no_ca_tuned', 'mpcc_no_ca'))
    assert tuned['mpcc_no_ca_tuned'].dash == plain['mpcc_no_ca'].dash == style.DASHED


def test_curves_that_coincide_stay_visible_and_every_run_has_a_dash_of_its_own():
    looks = style.assign_looks(['mpcc', 'mpcc_no_ca', 'frenet', 'own', 'another'])
    widths = [look.width for look in looks.values()]
    assert widths == sorted(widths, reverse=True)
    assert len(set(widths)) == len(widths)
    assert len({(look.colour, look.dash) for look in looks.values()}) == len(looks)
    assert len({looks[name].dash for name in style.KNOWN}) == len(style.KNOWN)
    assert len({look.dash for look in looks.values()}) > 3
    assert looks['own'].dash != looks['another'].dash not in {looks[n].dash for n in style.KNOWN}
    # what is drawn over a solid line has gaps that show it
    assert looks['mpcc'].dash == style.SOLID
    assert looks['frenet'].dash != style.SOLID


def simulate_colour_blindness(colour, matrix):
    """Return the linear RGB that a dichromat sees (Machado et al. 2009, severity 1)."""
    rgb = np.array([int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return np.clip(np.array(matrix) @ linear, 0.0, 1.0)


def lab(linear):
    """Return CIELAB of linear sRGB, white D65."""
    xyz = (
        np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
        @ linear
        / np.array([0.9505, 1.0, 1.089])
    )
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize(
    'matrix',
    [
        [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [  # protanopia
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ],
        [  # deuteranopia
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ],
    ],
)
def test_the_colours_of_the_known_controllers_differ_for_colour_blind_readers(matrix):
    seen = [lab(simulate_colour_blindness(colour, matrix)) for colour in style.KNOWN.values()]
    for k, one in enumerate(seen):
        for other in seen[k + 1 :]:
            assert np.linalg.norm(one - other) > 20.0


def test_an_axis_is_not_filled_by_noise_and_holds_every_value():
    noise = 20.0 + 0.01 * np.sin(np.arange(100.0))
    low, high = panels.axis_limits('velocity', [noise])
    assert high - low == pytest.approx(panels.LEAST_SPANS['velocity'])
    low, high = panels.axis_limits('velocity', [noise, np.array([3.0, np.nan, 31.0])])
    assert low < 3.0 < 31.0 < high
    low, high = panels.axis_limits('sideslip', [np.full(3, np.nan)])
    assert (low, high) == (-1.0, 1.0)


def test_of_labels_that_cover_each_other_the_first_stays():
    figure = comparison_figures.Figure(figsize=(4, 2))
    FigureCanvasAgg(figure)
    ax = figure.add_subplot()
    texts = [ax.text(x, 0.5, '1.2 s', gid=style.TIME_LABEL) for x in (0.1, 0.12, 0.6)]
    other = ax.text(0.1, 0.5, 'no time')
    style.hide_overlapping(figure, style.TIME_LABEL)
    assert [text.get_visible() for text in (*texts, other)] == [True, False, True, True]


def test_many_runs_of_a_controller_share_a_colour_and_a_line_of_the_legend():
    controllers = ['mpcc', 'frenet', 'own'] * 10
    names = [f'{name}@{k}' for k, name in enumerate(controllers)]
    looks = style.assign_looks(names, controllers)
    assert len({look.colour for look in looks.values()}) == 3
    assert looks['mpcc@0'].colour == style.KNOWN['mpcc']
    assert {look.width for look in looks.values()} == {style.MANY_WIDTH}
    assert list(style.legend_looks(looks, controllers)) == [
        *('mpcc: 10 runs', 'frenet: 10 runs', 'own: 10 runs'),
    ]
    # so many controllers have no colours that are told apart
    looks = style.assign_looks(names, names)
    assert list(style.legend_looks(looks, names)) == ['30 runs']
    few = style.assign_looks(names[:3], controllers[:3])
    assert style.legend_looks(few, controllers[:3]) == few
