"""The metrics as CSV are those of the JSON, digit for digit."""

import csv
import io

from bags import metrics_table
from bags.evaluation import metrics


def test_every_number_is_there_with_every_digit(make_drive):
    runs = {
        'mpcc': metrics.compute_metrics(make_drive(y=lambda x: x / 300.0)),
        'own': metrics.compute_metrics(make_drive(force=-600.0)),
    }
    rows = {
        row['metric']: row for row in csv.DictReader(io.StringIO(metrics_table.metrics_csv(runs)))
    }
    for name, result in runs.items():
        assert float(rows['rms_contouring_m'][name]) == result['rms_contouring_m']
        assert float(rows['solve_ms.p99'][name]) == result['solve_ms']['p99']
        assert rows['completed'][name] == str(result['completed']).lower()
        assert rows['min_v2o_m'][name] == ''
    assert rows['brake_onset_at_m']['mpcc'] == ''
    assert float(rows['brake_onset_at_m']['own']) == runs['own']['brake_onset_at_m']


def test_a_run_with_more_of_something_gives_the_other_an_empty_cell():
    text = metrics_table.metrics_csv({'a': {'overshoots': [{'x_m': 1.5}]}, 'b': {'overshoots': []}})
    assert text == 'metric,a,b\novershoots.0.x_m,1.5,\n'


def test_the_peak_sideslip_of_a_car_that_spun_is_not_shown_as_a_number(make_drive):
    run = metrics.compute_metrics(make_drive())
    spun = run | {'lost': True, 'lost_how': 'spun', 'peak_sideslip_deg': 179.3}
    rows = {line.title: line for line in metrics_table.table_lines({'a': run, 'b': spun})}
    controlled, lost = rows['peak sideslip angle'].cells
    assert controlled.text == f'{run["peak_sideslip_deg"]:.1f}'
    assert lost.text == 'spun'
    # what is recorded stays
    assert 'peak_sideslip_deg,179.3' in metrics_table.metrics_csv({'b': spun})
