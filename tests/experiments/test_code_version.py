"""The digest that decides whether a stored drive is reused follows the imports."""

import pytest

from experiments import code_version
from node_runtime import provenance


def test_modules_that_simulate_solve_and_evaluate_belong_to_the_version():
    assert set(code_version.modules()) >= {
        'experiments.simulation',
        'mpcc_controller.driving.controller',
        'stage_solver.solver',
        'vehicle_plant.tyre',
        'scenario_publisher.scenario',
        'bags.evaluation.metrics',
        'msgs_yaml.types',
    }


def test_nodes_figures_and_studies_do_not_belong_to_it():
    found = code_version.modules()
    assert not [name for name in found if name.endswith('_node')]
    assert not [name for name in found if name.startswith(('bags.report', 'experiments.tuning'))]


@pytest.mark.parametrize(
    ('kind', 'name'),
    [('modules', 'vehicle_plant.tyre'), ('_templates', 'stage_solver/riccati_c/solve.c')],
)
def test_a_changed_line_of_a_module_or_a_template_is_another_version(
    monkeypatch, tmp_path, kind, name
):
    before, files = code_version.digest.__wrapped__(), getattr(code_version, kind)()
    changed = tmp_path / 'changed'
    changed.write_text(files[name].read_text())
    monkeypatch.setattr(code_version, kind, lambda *_: {**files, name: changed})
    assert code_version.digest.__wrapped__() == before
    changed.write_text(files[name].read_text() + '\n')
    assert code_version.digest.__wrapped__() != before


def test_every_package_of_the_project_may_be_followed():
    assert {name.split('.')[0] for name in code_version.modules()} <= set(provenance.PACKAGES)


@pytest.mark.parametrize('library', ['casadi', 'numpy', 'commonroad-vehicle-models'])
def test_another_version_of_a_library_that_drives_is_another_version(monkeypatch, library):
    before = code_version.digest.__wrapped__()
    versions = {**provenance.versions(), library: '0.0.1'}
    monkeypatch.setattr(provenance, 'versions', lambda: versions)
    assert code_version.digest.__wrapped__() != before
    assert code_version.describe.__wrapped__()[library] == '0.0.1'
