"""The rows of the ablation differ in what they say they differ in."""

import pytest

from bags.errors import BagError
from experiments import simulation
from experiments.study import run_spec, variants
from node_runtime import parameters

DRAW = run_spec.Draw(1, 0.0, 1.0, 1e-6)
# parameters by which the rows of a switch may differ
FACTORS = {
    'frame of the distances': {'formulation.distance'},
    'lag error': {'formulation.lag'},
    'priority, equal P_k': {'formulation.priority'},
    'priority, equal penalty': {'formulation.priority', 'priorities.obstacle', 'priorities.edge'},
    'size of the priority': {'priorities.obstacle', 'priorities.edge'},
    'heading error': {'formulation.heading'},
    'priority at all': {'priorities.obstacle', 'priorities.edge'},
    'priority back, equal P_k': {'formulation.priority'},
    'size back': {'priorities.obstacle', 'priorities.edge'},
    'heading error dropped': {'formulation.heading'},
    'states back to the map': {'formulation.name'},
    'brake split fixed': {'limits.brake_front_share_min', 'limits.brake_front_share_max'},
}


@pytest.fixture(scope='module')
def rows():
    return {one.name: one for one in variants.ablation_variants()}


def settings(variant):
    chosen = {'controller': dict(variant.settings)}
    made = simulation.prepare(variants.SCENARIO, variant.controller, chosen)
    return parameters.flatten(made.params)


@pytest.mark.parametrize('switch', variants.SWITCHES, ids=lambda switch: switch.factor)
def test_a_switch_changes_its_factor_only(rows, switch):
    before, after = settings(rows[switch.before]), settings(rows[switch.after])
    assert {name for name in before if before[name] != after[name]} == FACTORS[switch.factor]


def test_the_base_of_the_ablation_is_the_mpcc_and_is_simulated_once(rows):
    base, plain = rows[variants.BASE], variants.plain_variants(['mpcc'])[0]
    specs = [run_spec.build_spec(one, 75.0, DRAW) for one in (base, plain)]
    keys = {run_spec.cache_key(run_spec.prepare(spec)) for spec in specs}
    assert len(keys) == 1


def test_a_row_at_a_share_of_the_priority_has_that_share(rows):
    full, part = (settings(rows[name]) for name in ('cartesian lag step', 'cartesian lag step/4'))
    for name in ('priorities.obstacle', 'priorities.edge'):
        assert part[name] == variants.EQUAL_PENALTY * full[name]


def test_a_controller_without_a_role_is_a_further_row(tmp_path):
    files = [tmp_path / 'mpcc.yaml', tmp_path / 'frenet_tuned.yaml']
    for file in files:
        file.write_text('')
    found = variants.further_variants(variants.ROLES, files)
    assert [one.name for one in found] == ['mpcc tuned', 'frenet_tuned']
    assert variants.further_variants({}, files) == found  # whoever is not named plays himself
    roles = {'frenet': 'frenet_tuned'}
    found = variants.further_variants(roles, files)
    assert [one.name for one in found] == ['frenet untuned', 'mpcc tuned']
    with pytest.raises(BagError, match='no such file'):
        variants.further_variants(roles, [tmp_path / 'frenet.yaml'])
    with pytest.raises(BagError, match='one name'):
        variants.further_variants(roles, [files[0], files[0]])


def test_an_unknown_role_is_named():
    with pytest.raises(BagError, match='mpc_c'):
        variants.role_variants({'mpc_c': 'mpcc'})
