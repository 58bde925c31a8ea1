"""Drives of a study are those of the closed loop, made once, and kept."""

import json

import pytest

from bags.errors import BagError
from bags.evaluation import metrics
from experiments import simulation
from experiments.study import case, drives, samples, variants

MPCC, NO_CA = variants.plain(['mpcc', 'mpcc_no_ca'])
TIMES = ('solve_ms', 'solve_cpu_ms')


def cases(*numbers, variant=MPCC):
    draws = samples.draws(max(numbers))
    return [case.of(variant, 75.0, draws[n - 1], variants.SCENARIO) for n in numbers]


def test_a_drive_is_that_of_the_closed_loop_and_is_made_once(tmp_path):
    seen = []
    with drives.Drives(2, lambda *said: seen.append(said), tmp_path) as made:
        first, second = made.of(cases(1, 2), 'two')
        assert made.driven == 2
        assert made.of(cases(2, 1, 2), 'again') == [second, first, second]
        assert made.driven == 2
    assert seen[0] == ('two', 0, 2)
    assert seen[2] == ('two', 2, 2)
    assert seen[3] == ('again', 2, 2)
    wanted = metrics.compute_metrics(simulation.drive(case.prepared(first.case)))
    differ = [name for name in wanted if wanted[name] != first.metrics[name]]
    assert set(differ) <= set(TIMES)
    assert first.value('solver.failed') == 0
    assert first.value('min_v2o_per_obstacle_m.1') == wanted['min_v2o_per_obstacle_m']['1']


def test_what_was_driven_is_read_and_only_the_rest_is_driven(tmp_path):
    kept = {'metrics': {'min_v2o_m': 1.25}, 'solver': {}}
    chosen = cases(1, 2)
    for one in chosen:
        (tmp_path / f'{case.key(one)}.json').write_text(json.dumps(kept))
    with drives.Drives(1, cache=tmp_path) as made:
        assert [one.value('min_v2o_m') for one in made.of(chosen, 'kept')] == [1.25, 1.25]
        assert made.driven == 0


def test_the_draw_reaches_speed_grip_and_tolerance_but_not_the_belief():
    (one,) = cases(3)
    setup = case.prepared(one)
    draw = samples.draws(3)[2]
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
def test_the_key_knows_everything_that_decides_a_drive(changed):
    one = case.Case(variants.SCENARIO, 'mpcc', (), 75.0, 1.0, 1e-6)
    assert case.key(one) != case.key(one._replace(**changed))


def test_a_setting_that_changes_nothing_is_the_same_drive():
    one = case.Case(variants.SCENARIO, 'mpcc', (), 75.0, 1.0, 1e-6)
    assert case.key(one) == case.key(one._replace(settings=(('safety.obstacle_m', 0.5),)))


def test_jobs_have_to_be_some():
    with pytest.raises(BagError, match='at least 1'):
        drives.Drives(-1)
