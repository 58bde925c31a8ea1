"""Runs of several scenarios: found below a folder, in one table, one CSV file, one figure."""

import copy
import csv

import pytest

from bags import cli
from bags.errors import BagError
from bags.evaluation import metrics
from bags.report import overview


@pytest.fixture(scope='module')
def folder(tmp_path_factory, write_bag_into, drives):
    """Return a folder with one scenario driven twice, and runs that do not count."""
    folder = tmp_path_factory.mktemp('runs')
    for name in ('mpcc', 'own'):
        write_bag_into(folder / 'straight', drives[name], name)
    for aside in ('straight/mpcc.interrupted', '.hidden/mpcc'):
        bag = folder / aside
        bag.mkdir(parents=True)
        (bag / 'metadata.yaml').write_text('{}')
    return folder


@pytest.fixture(scope='module')
def rows(folder):
    """Return the runs of the folder, one of them as if of another scenario."""
    first, second = overview.read_runs(overview.find_bags([folder]))
    third = copy.copy(first)
    third.run_info = first.run_info | {'scenario': 'elsewhere'}
    return [first, second, third]


def test_bags_are_found_below_a_folder_and_given_ones_count_once(folder, tmp_path):
    bags = [folder / 'straight/mpcc', folder / 'straight/own']
    assert overview.find_bags([folder]) == bags
    assert overview.find_bags([bags[1], folder]) == bags[::-1]
    with pytest.raises(BagError, match='is no bag, and none is below it'):
        overview.find_bags([tmp_path])


def test_the_csv_has_a_row_per_run_with_the_metrics_of_the_comparison(rows, drives):
    table = list(csv.DictReader(overview.overview_csv(rows).splitlines()))
    assert [(row['scenario'], row['run']) for row in table] == [
        ('straight', 'mpcc'),
        ('straight', 'own'),
        ('elsewhere', 'mpcc'),
    ]
    wanted = metrics.compute_metrics(drives['mpcc'])
    for name in overview.SHOWN:
        assert rows[0].metrics[name] == pytest.approx(wanted[name], abs=1e-6)
    assert float(table[0]['min_v2o_m']) == rows[0].metrics['min_v2o_m']


def test_the_figure_has_a_mark_per_run_and_metric_that_is_a_number(rows):
    chosen = overview.choose_metrics(overview.SHOWN)
    figure = overview.draw_overview(rows, chosen)
    numbers = [metric for metric in chosen if metric.unit]
    assert len(figure.axes) == len(numbers)
    for ax, metric in zip(figure.axes, numbers):
        assert f'[{metric.unit}]' in ax.get_xlabel()
        assert sum(len(line.get_xdata()) for line in ax.get_lines()) == len(rows)
    shown = [label.get_text() for label in figure.axes[0].get_yticklabels()]
    assert shown == ['straight', 'elsewhere']
    with pytest.raises(BagError, match='none of these metrics is a number'):
        overview.draw_overview(rows, overview.choose_metrics(['collided']))


def test_runs_of_one_scenario_that_cannot_be_compared_are_named(rows):
    assert list(overview.unlike(rows)) == []
    other = copy.copy(rows[1])
    other.run_info = rows[1].run_info | {'scenario_sha256': 'other'}
    (line,) = overview.unlike([rows[0], other, rows[2]])
    assert "two versions of 'straight'" in line


def test_the_command_prints_a_table_and_writes_files(folder, tmp_path, capsys):
    out = tmp_path / 'out'
    assert cli.main(['overview', str(folder), '--out', str(out)]) == 0
    printed = capsys.readouterr().out
    assert printed.count('straight') == 1
    assert '  own' in printed
    assert {file.name for file in out.iterdir()} == {
        'overview.csv',
        'overview.png',
        'overview.svg',
    }
    assert cli.main(['overview', str(folder), '--metric', 'min_v2']) == 1
    assert "no metric 'min_v2'; did you mean 'min_v2" in capsys.readouterr().err
    assert cli.main(['overview', str(folder), '--metric', 'overshoots']) == 1
    assert 'overshoots has several values per run' in capsys.readouterr().err
