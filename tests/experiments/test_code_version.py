"""The digest that decides whether a stored drive is reused follows the imports."""

from experiments import code_version
from node_runtime import provenance


def test_what_simulates_solves_and_evaluates_belongs_to_the_version_and_nothing_else():
    modules = set(code_version.modules())
    assert modules >= {
        'experiments.simulation',
        'mpcc_controller.driving.controller',
        'stage_solver.solver',
        'vehicle_plant.tyre',
        'scenario_publisher.scenario',
        'bags.evaluation.metrics',
        'msgs_yaml.types',
    }
    others = ('bags.report', 'experiments.tuning')
    assert not [name for name in modules if name.endswith('_node') or name.startswith(others)]
    assert {name.split('.')[0] for name in modules} <= set(provenance.PACKAGES)


def test_another_line_of_code_or_version_of_a_library_is_another_version(monkeypatch, tmp_path):
    roots = ('vehicle_plant.tyre',)  # fewer files than a drive has

    def digest():
        return code_version.digest.__wrapped__(roots)

    before, changed = digest(), tmp_path / 'changed'
    for kind, files, name in (
        ('modules', code_version.modules(roots), 'vehicle_plant.tyre'),
        ('_templates', code_version._templates(), 'stage_solver/riccati_c/solve.c'),
    ):
        changed.write_text(files[name].read_text() + '\n')
        with monkeypatch.context() as patched:
            patched.setattr(code_version, kind, lambda *_, f=files, n=name: {**f, n: changed})
            assert digest() != before
            changed.write_text(files[name].read_text())
            assert digest() == before
    for library in ('casadi', 'numpy', 'commonroad-vehicle-models'):
        versions = {**provenance.versions(), library: '0.0.1'}
        with monkeypatch.context() as patched:
            patched.setattr(provenance, 'versions', lambda v=versions: v)
            assert digest() != before
            assert code_version.describe.__wrapped__(roots)[library] == '0.0.1'
