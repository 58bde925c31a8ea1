"""Drives of a study are those of the closed loop, made once, and kept."""

import json

import pytest

from bags.errors import BagError
from bags.evaluation import metrics
from experiments import simulation
from experiments.study import run_spec, runner, variants

MPCC, NO_CA = variants.plain_variants(['mpcc', 'mpcc_no_ca'])
TIMES = ('solve_ms', 'solve_cpu_ms')


def specs(*numbers, variant=MPCC):
    draws = run_spec.draw_runs(max(numbers))
    return [run_spec.build_spec(variant, 75.0, draws[n - 1]) for n in numbers]


def key(spec):
    return run_spec.cache_key(run_spec.prepare(spec))


def test_a_run_equals_the_simulation_and_is_cached(tmp_path):
    seen = []
    with runner.Runner(2, lambda *text: seen.append(text), tmp_path) as runs:
        first, second = runs.run(specs(1, 2), 'two')
        assert runs.simulated == 2
        assert runs.run(specs(2, 1, 2), 'again') == [second, first, second]
        assert runs.simulated == 2
    assert seen[0] == ('two', 0, 2)
    assert seen[2] == ('two', 2, 2)
    assert seen[3] == ('again', 2, 2)
    wanted = metrics.compute_metrics(simulation.drive(run_spec.prepare(first.spec)))
    differ = [name for name in wanted if wanted[name] != first.metrics[name]]
    assert set(differ) <= set(TIMES)
    assert first.value('solver.failed') == 0
    assert first.value('min_v2o_per_obstacle_m.1') == wanted['min_v2o_per_obstacle_m']['1']


def test_only_missing_runs_are_simulated(tmp_path):
    kept = {'metrics': {'min_v2o_m': 1.25}, 'solver': {}}
    chosen = specs(1, 2)
    for one in chosen:
        (tmp_path / f'{key(one)}.json').write_text(json.dumps(kept))
    with runner.Runner(1, cache=tmp_path) as runs:
        assert [one.value('min_v2o_m') for one in runs.run(chosen, 'kept')] == [1.25, 1.25]
        assert runs.simulated == 0


def test_the_draw_changes_speed_grip_and_tolerance_but_not_the_assumed_friction():
    (one,) = specs(3)
    setup = run_spec.prepare(one)
    draw = run_spec.draw_runs(3)[2]
    assert setup.params.solver.tolerance == draw.tolerance
    assert setup.friction == draw.grip
    assert setup.params.model.friction == 1.0
    assert setup.scn.start.speed == pytest.approx((75.0 + draw.speed_kph) / 3.6)


@pytest.mark.parametrize(
    'changed',
    [
        {'speed_kph': 75.01},
        {'grip': 1.001},
        {'tolerance': 1.1e-6},
        {'controller': 'frenet'},
        {'settings': (('tolerances.lag_m', 0.4),)},
        {'scenario': 'circle_20m'},
    ],
    ids=lambda changed: next(iter(changed)),
)
def test_the_cache_key_depends_on_everything_that_decides_a_run(changed):
    one = run_spec.RunSpec(variants.SCENARIO, 'mpcc', (), 75.0, 1.0, 1e-6)
    assert key(one) != key(one._replace(**changed))


def test_a_setting_that_changes_nothing_has_the_same_cache_key():
    one = run_spec.RunSpec(variants.SCENARIO, 'mpcc', (), 75.0, 1.0, 1e-6)
    assert key(one) == key(one._replace(settings=(('safety.obstacle_m', 0.5),)))


def test_the_number_of_jobs_must_be_positive():
    with pytest.raises(BagError, match='at least 1'):
        runner.Runner(-1)
