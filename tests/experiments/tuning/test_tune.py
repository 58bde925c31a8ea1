"""Weights are searched with real drives: what the search depends on, and what it writes."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from rich.console import Console

from experiments.configuration import node_config
from experiments.pool import Pool
from experiments.tuning import problem, tune, weight_search
from experiments.tuning.problem import Condition, Score
from experiments.tuning.weight_search import SearchPlan
from mpcc_controller.problem import formulation
from msgs_yaml import share
from node_runtime import parameters

PLAN = SearchPlan(
    controller='mpcc',
    seed=3,
    trials=(3, 2),
    random=(2, 2),
    batch=2,
    conditions=(Condition(60.0, 1.0),),
    tracking_m=0.3,
)
SAFE = Score(1.0, 3.0, 0.0, 0.0, 0.0, 0.1)
CONFIG = share.path('mpcc_controller', 'config')
BASE = CONFIG / 'mpcc.yaml'
SEARCHES = Path(__file__).parents[3] / 'paper/tuning'


def ignore(*_):
    pass


@pytest.fixture(scope='module')
def whole(tmp_path_factory):
    """A search with one process, from start to end: its folder and trials."""
    folder = tmp_path_factory.mktemp('whole')
    with Pool(1) as pool:
        return folder, weight_search.run(PLAN, folder, pool, ignore, ignore)


@pytest.fixture(scope='module')
def trials(whole):
    return whole[1]


def test_an_interrupted_search_continues_and_stages_begin_with_the_best_before(whole, tmp_path):
    def stop(trial):
        raise KeyboardInterrupt

    folder, trials = whole
    with Pool(2) as pool:
        with pytest.raises(KeyboardInterrupt):
            weight_search.run(PLAN, tmp_path, pool, ignore, stop)
        seen, others = [], []
        found = weight_search.run(PLAN, tmp_path, pool, lambda: seen.append(1), ignore)
        # drives of another search do not count: only the untuned weights are the same
        other = PLAN._replace(seed=4)
        weight_search.run(other, folder, pool, lambda: others.append(1), ignore)
    assert found == trials
    # of five drives the two of the first batch were known, and stage 2 begins with the best of them
    assert len(seen) == 2
    assert len(others) >= 3
    first, second = (next(t for t in trials if t.stage == stage) for stage in (1, 2))
    assert first.weights['tolerances.contouring_m'] == 0.5
    best = weight_search.find_best([trial for trial in trials if trial.stage == 1])
    assert (second.weights, second.scores) == (best.weights, best.scores)


def test_a_feasible_trial_is_better_than_a_cheap_one(trials):
    safe = trials[0]
    scores = (safe.scores[0]._replace(sideslip_peak_deg=0.0),)
    cheap = safe._replace(violations=(0.1, 0.0, 0.0, 0.0), scores=scores)
    assert cheap.cost < safe.cost
    assert weight_search.find_best([cheap, safe]) is safe


def test_costs_and_violations_of_runs():
    # a metre per second counts as much as three degrees
    assert SAFE.cost == pytest.approx(2.0)
    assert problem.cost([SAFE, SAFE._replace(velocity_rms_mps=3.0)]) == pytest.approx(3.0)
    near, lost = SAFE._replace(missing_v2o_m=0.2), SAFE._replace(contouring_rms_m=0.5)
    found = problem.violations([SAFE, near, lost], tracking_m=0.3)
    assert found == pytest.approx((0.2, 0.0, 0.0, 0.2))
    assert problem.violations([SAFE], tracking_m=0.3) == (0.0, 0.0, 0.0, 0.0)


def test_the_score_of_a_run_equals_a_hand_calculation(make_drive):
    # 20 m/s and 2 m/s to the side, 21 m/s desired; 0.1 m off the path, edges 3 m from it
    found = problem.score(make_drive(y=0.1, vy=2.0), 21.0)
    assert found.velocity_rms_mps == pytest.approx(1.0)
    assert found.sideslip_peak_deg == pytest.approx(np.degrees(np.arctan2(2.0, 20.0)))
    assert found.missing_v2e_m == found.missing_v2o_m == found.not_completed == 0.0
    assert found.contouring_rms_m == pytest.approx(0.1)
    # the circle of 1.1 m at y = 1.6 m is 0.3 m from the edge at 3 m, 0.5 m are safe
    assert problem.score(make_drive(y=1.6), 20.0).missing_v2e_m == pytest.approx(0.2)
    assert problem.score(make_drive(metres=40.0), 20.0).not_completed == 1.0


def test_both_controllers_search_the_same_ranges_the_second_stage_narrower_ones():
    mpcc, frenet = (
        problem.wide_spans(problem.untuned_weights(name)) for name in ('mpcc', 'frenet')
    )
    common = set(mpcc) & set(frenet)
    assert len(common) == 6
    assert all(mpcc[name] == frenet[name] for name in common)
    assert set(mpcc) - common == {'tolerances.lag_m'}
    assert set(frenet) - common == {'tolerances.heading_rad'}
    untuned = {'a': 0.5, 'b': 2e4}
    wide = problem.wide_spans(untuned)
    for name, span in wide.items():
        assert span.high / untuned[name] == pytest.approx(untuned[name] / span.low)
    best = {'a': 1.0, 'b': wide['b'].high}
    narrow = problem.narrow_spans(wide, best)
    decades = [np.log10(spans['a'].high / spans['a'].low) for spans in (wide, narrow)]
    assert decades[1] == pytest.approx(decades[0] / problem.NARROWING)
    assert narrow['b'].high == wide['b'].high
    assert all(narrow[name].low <= best[name] <= narrow[name].high for name in best)


def test_files_are_written_for_the_tuned_controller_and_its_sibling(whole, tmp_path):
    folder, trials = whole
    found = tune.write(PLAN, trials, folder, tmp_path, ['mpcc_no_ca'])
    assert [path.name for path in found.files] == ['mpcc_tuned.yaml', 'mpcc_no_ca_tuned.yaml']
    assert found.summary['best']['cost'] <= found.summary['untuned']['cost']
    assert found.summary['untuned']['violated'] == []
    tuned, sibling = found.files
    assert 'experiments tune mpcc --seed 3 --trials 3 2 --tracking 0.3' in tuned.read_text()
    assert parameters.read_file(sibling, CONFIG).values['priorities.obstacle'] == 0.0
    assert len((folder / tune.HISTORY).read_text().splitlines()) == 1 + len(trials)
    assert all(path.stat().st_size > 10_000 for path in found.figures)


def test_an_infeasible_untuned_controller_is_reported_as_infeasible(trials, tmp_path, monkeypatch):
    monkeypatch.setenv('COLUMNS', '100')
    broken = [trials[0]._replace(violations=(0.19, 0.0, 1.0, 0.15)), *trials[1:]]
    summary = tune.summarise(PLAN, broken)
    assert not summary['untuned']['safe']
    shown = io.StringIO()
    tune.show(tune.Result(summary, [tmp_path], [tmp_path]), Console(file=shown))
    assert (
        'untuned: infeasible, min V2O 0.31 m < 0.5 m, not completed, '
        'path tracked to 0.45 m > 0.3 m' in shown.getvalue()
    )
    assert 'infeasible' in tune._cost_note(broken).partition('->')[0]


def read(folder, text):
    path = folder / 'tuned.yaml'
    path.write_text(text)
    return parameters.read_file(path, CONFIG).values


@pytest.mark.parametrize('value', [1e-07, 1.0, 123456.0, 2.5e22, 0.349])
def test_a_tuned_file_holds_the_tuned_weights_over_its_base(value, tmp_path):
    changed = {'tolerances.lag_m': value, 'priorities.obstacle': 54321.0}
    text = tune.controller_text(BASE, changed, ['From a test.', 'word ' * 60])
    assert read(tmp_path, text) == parameters.read_file(BASE, CONFIG).values | changed
    assert text.startswith('# From a test.\n')
    own = yaml.safe_load(text)['/**']['ros__parameters']
    assert set(own) == {'base', 'tolerances', 'priorities'}
    header = [line for line in text.splitlines() if line.startswith('#')]
    assert len(header) == 5
    assert all(len(line) <= tune.WIDTH for line in header)
    with pytest.raises(KeyError, match=r'tolerances\.lug_m'):
        tune.controller_text(BASE, {'tolerances.lug_m': value}, [])


def test_a_base_outside_of_the_config_folder_is_named_by_its_path(tmp_path):
    own = tmp_path / 'sub/mine.yaml'
    own.parent.mkdir()
    own.write_text(BASE.read_text().replace('lag_m: 0.5', 'lag_m: 0.6'))
    values = read(tmp_path, tune.controller_text(own, {'priorities.edge': 2.0}, []))
    assert (values['tolerances.lag_m'], values['priorities.edge']) == (0.6, 2.0)


def numbers(name):
    return parameters.read_file(node_config.find_controller(name).config).values


def test_the_shipped_tuned_controllers_are_those_that_the_tracked_searches_found():
    searches = {
        name: json.loads((SEARCHES / name / 'tuning.json').read_text())
        for name in ('mpcc', 'frenet')
    }
    for name, search in searches.items():
        weights = search['best']['weights']
        assert set(weights) == set(formulation.find(name).tuned_weights)
        assert numbers(f'{name}_tuned') == numbers(name) | weights
        assert search['best']['safe']
        assert search['best']['cost'] < search['untuned']['cost']
        assert search['plan'] | {'controller': None} == searches['mpcc']['plan'] | {
            'controller': None
        }
    zero = {'priorities.obstacle': 0.0, 'priorities.edge': 0.0}
    assert numbers('mpcc_no_ca_tuned') == numbers('mpcc_tuned') | zero
