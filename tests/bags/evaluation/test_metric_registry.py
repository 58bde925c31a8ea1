"""A metric costs one function: table, JSON, CSV and list follow from its registration."""

import json

import pytest
from evaluated_drives import compare_drives

from bags import cli, metrics_table
from bags.evaluation.metrics import registry


@pytest.fixture
def top_speed():
    """A metric as somebody would add it, registered for this test only."""
    before = dict(registry.METRICS)

    @registry.metric('top speed', 'km/h', 1)
    def top_speed_kmph(run):
        """Largest speed over ground."""
        return 3.6 * float(run.series.speed.max())

    yield top_speed_kmph
    registry.METRICS.clear()
    registry.METRICS.update(before)


def test_a_registered_metric_is_in_the_json_the_csv_and_the_table(top_speed, make_drive, tmp_path):
    compare_drives({'mpcc': make_drive()}, tmp_path)
    values = json.loads((tmp_path / 'comparison.json').read_text())
    assert values['runs']['mpcc']['top_speed_kmph'] == pytest.approx(72.0)
    assert 'top_speed_kmph,7' in (tmp_path / 'comparison.csv').read_text()
    (line,) = (x for x in metrics_table.table_lines(values['runs']) if x.title == 'top speed')
    assert (line.unit, line.cells[0].text) == ('km/h', '72.0')
    assert 'top speed' in (tmp_path / 'report.html').read_text()


def test_the_list_of_metrics_prints_what_each_means(top_speed, capsys):
    with pytest.raises(SystemExit) as ended:
        cli.main(['compare', '--list-metrics'])
    assert not ended.value.code
    listed = capsys.readouterr().out
    assert 'top_speed_kmph [km/h]: Largest speed over ground.' in listed
    assert 'completed: Whether the car reached' in listed


def test_two_metrics_of_one_name_are_refused(top_speed):
    with pytest.raises(ValueError, match='top_speed_kmph is registered already'):
        registry.metric()(top_speed)


def test_every_metric_says_in_one_sentence_what_it_is():
    assert all(metric.meaning for metric in registry.METRICS.values())
