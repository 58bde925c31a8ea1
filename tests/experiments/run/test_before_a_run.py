"""What is checked, and what is said, before any node of a run starts."""

import io

import pytest
from rich.console import Console

from bags.errors import BagError
from experiments.run import run_and_compare
from msgs_yaml import share


def test_an_expectation_of_no_metric_is_refused_before_the_run(tmp_path):
    text = share.path('scenario_publisher', 'scenarios', 'straight.yaml').read_text()
    path = tmp_path / 'straight.yaml'
    path.write_text(text + 'expect: {survive: true}\n')
    request = run_and_compare.Request(str(path), ['mpcc'], 'lockstep', tmp_path / 'out', (), 60.0)
    with pytest.raises(BagError, match=r'expect\.survive: no such metric.*survived'):
        run_and_compare.run(request, Console())
    assert not (tmp_path / 'out').exists()


def test_another_car_that_is_driven_all_the_same_is_told_with_all_that_differs(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(run_and_compare, '_run_each', lambda *_: [])
    settings = ['plant.plant_params=vw_gti.yaml']
    request = run_and_compare.Request(
        'straight', ['mpcc'], 'lockstep', tmp_path / 'out', settings, 60.0
    )
    with pytest.raises(BagError, match='does not fit the plant: wheelbase'):
        run_and_compare.run_controllers(request, Console())
    console = Console(file=io.StringIO(), width=400)
    run_and_compare.run_controllers(request._replace(any_car=True), console)
    said = ' '.join(console.file.getvalue().split())
    assert 'warning, mpcc: car_file car.yaml does not fit the plant: wheelbase 2.89 m' in said
    assert 'load of the rear axle' in said
