"""Curves of a CSV file beside those of the runs: read, refused, drawn in figures and report."""

import json

import numpy as np
import pytest

from bags import cli
from bags.errors import BagError
from bags.figures import comparison_figures, style
from bags.figures.overlay import AXES, SIGNALS, read_overlays

MEASURED = """# read off a figure
time_s, vx_mps, steer_deg, x_m, y_m
0.0,    20.0,   0.0,       0.0, 0.0
1.0,    19.0,   -2.0,      20.0, 0.5
2.0,    ,       1.0,       40.0, -0.5
"""


@pytest.fixture
def measured(tmp_path):
    file = tmp_path / 'measured.csv'
    file.write_text(MEASURED)
    return file


@pytest.fixture
def overlay(measured, runs):
    (one,) = read_overlays([measured], [run.name for run in runs], runs[0].drive.scene)
    return one


def test_a_file_is_read_and_positions_give_the_station(overlay):
    assert overlay.name == 'measured'
    assert overlay.axes['time_s'].tolist() == [0.0, 1.0, 2.0]
    assert overlay.axes['station_m'] == pytest.approx([0.0, 20.0, 40.0])
    assert overlay.signals['velocity'] == pytest.approx([20.0, 19.0, np.nan], nan_ok=True)
    assert overlay.signals['steer'].tolist() == [0.0, -2.0, 1.0]
    assert overlay.signals['contouring'] == pytest.approx([0.0, 0.5, -0.5])


def test_units_are_converted_to_those_of_the_panels(tmp_path, runs):
    file = tmp_path / 'si.csv'
    file.write_text('station_m,sideslip_rad,force_x_n\n1.0,0.1,2500\n')
    (one,) = read_overlays([file], [], runs[0].drive.scene)
    assert one.signals['sideslip'] == pytest.approx(np.degrees([0.1]))
    assert one.signals['force'] == pytest.approx([2.5])


def test_every_column_belongs_to_a_panel():
    drawn = {panel.name for panel in comparison_figures.PANELS} | {'gg_x'}
    assert {signal for signal, _ in SIGNALS.values()} == drawn
    assert not set(AXES) & set(SIGNALS)


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        ('', 'is empty'),
        ('time_s,vx_mps\n', 'no row below'),
        ('time_s,vx_mp\n0,1\n', "no column 'vx_mp' is known; did you mean 'vx_mps'?"),
        ('time_s,time_s\n0,1\n', 'two columns are called time_s'),
        ('time_s,vx_mps\n0,1\n1\n', 'line 3 has 1 cells, the first row 2'),
        ('time_s,vx_mps\n0,fast\n', "line 2: vx_mps is 'fast', which is no number"),
        ('time_s,vx_mps\n0,inf\n', 'line 2: vx_mps is not finite'),
        ('vx_mps\n1\n', 'needs time_s, station_m, or x_m and y_m; it has vx_mps'),
        ('time_s\n1\n', 'nothing to draw'),
        ('x_m,y_m\n1,\n', 'x_m and y_m must have a number in every row'),
        ('time_s,steer_rad,steer_deg\n0,1,1\n', 'two columns of steer'),
    ],
)
def test_a_file_that_cannot_be_drawn_is_refused_with_the_place(tmp_path, runs, text, said):
    file = tmp_path / 'own.csv'
    file.write_text(text)
    with pytest.raises(BagError) as refused:
        read_overlays([file], [], runs[0].drive.scene)
    assert str(refused.value).startswith(f'{file}: ')
    assert said in str(refused.value)


def test_two_things_of_one_name_are_refused(measured, runs):
    scene = runs[0].drive.scene
    for files, names in (([measured, measured], []), ([measured], ['measured'])):
        with pytest.raises(BagError, match="something else is called 'measured'"):
            read_overlays(files, names, scene)


def test_an_overlay_is_dotted_in_its_panels_and_nowhere_else(runs, overlay, tmp_path):
    for name, drawn in (('velocity', True), ('trajectories', True), ('gg', False)):
        figure = comparison_figures.draw_figure(name, runs, '', [overlay])
        (legend,) = figure.legends
        assert ('measured' in [text.get_text() for text in legend.get_texts()]) == drawn
        lines = [line for ax in figure.axes for line in ax.get_lines()]
        assert (overlay.look.colour in {line.get_color() for line in lines}) == drawn
    assert overlay.look.dash == style.DOTTED
    assert overlay.look.colour not in {run.look.colour for run in runs}
    # the axis grows to hold it
    file = tmp_path / 'fast.csv'
    file.write_text('station_m,vx_mps\n10,35\n20,40\n')
    (fast,) = read_overlays([file], [], runs[0].drive.scene)
    (ax,) = comparison_figures.draw_figure('velocity', runs, '', [fast]).axes
    assert ax.get_ylim()[1] >= 40.0


def test_the_command_takes_files_and_the_report_shows_and_lists_them(
    undrawn, drives, write_bag, measured, tmp_path, bags_prints, capsys
):
    bag = write_bag(drives['mpcc'])
    out = tmp_path / 'out'
    bags_prints('compare', bag, '--overlay', measured, '--out', out)
    values = json.loads((out / 'comparison.json').read_text())
    assert set(values['overlays']['measured']) >= {'time_s', 'velocity', 'steer'}
    text = (out / 'report.html').read_text()
    assert text.count('data-run="measured"') == 1
    assert text.count('data-key="measured"') == 3  # velocity, steer, contouring
    assert cli.main(['compare', str(bag), '--overlay', str(tmp_path / 'no.csv')]) == 1
    assert 'no.csv: cannot be read as CSV' in capsys.readouterr().err
