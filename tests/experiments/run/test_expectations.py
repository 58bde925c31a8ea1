"""What a scenario expects of a run is checked before any node starts."""

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
