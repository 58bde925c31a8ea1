"""Short searches with real drives: what they depend on, and what they do not."""

import io

import pytest
from matplotlib.figure import Figure
from rich.console import Console

from experiments.pool import Pool
from experiments.tuning import tune, tuning_figure, weight_search
from experiments.tuning.problem import Condition
from experiments.tuning.weight_search import SearchPlan
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


def ignore(*_):
    pass


@pytest.fixture(scope='module')
def whole(tmp_path_factory):
    """A search with one process, from start to end."""
    folder = tmp_path_factory.mktemp('whole')
    with Pool(1) as pool:
        return folder, weight_search.run(PLAN, folder, pool, ignore, ignore)


def test_an_interrupted_search_continues_with_the_same_trials(whole, tmp_path):
    def stop(trial):
        raise KeyboardInterrupt

    with Pool(2) as pool:
        with pytest.raises(KeyboardInterrupt):
            weight_search.run(PLAN, tmp_path, pool, ignore, stop)
        seen = []
        found = weight_search.run(PLAN, tmp_path, pool, lambda: seen.append(1), ignore)
    assert found == whole[1]
    # of five drives the two of the first batch were known, and stage 2 begins with the best of them
    assert len(seen) == 2


def test_the_stages_begin_with_the_untuned_weights_and_the_best_of_stage_1(whole):
    trials = whole[1]
    first, second = (next(t for t in trials if t.stage == stage) for stage in (1, 2))
    assert first.weights['tolerances.contouring_m'] == 0.5
    best = weight_search.find_best([trial for trial in trials if trial.stage == 1])
    assert second.weights == best.weights
    assert second.scores == best.scores


def test_drives_of_another_search_do_not_count(whole):
    folder, _ = whole
    seen = []
    with Pool(1) as pool:
        weight_search.run(PLAN._replace(seed=4), folder, pool, lambda: seen.append(1), ignore)
    # only the untuned weights are the same
    assert len(seen) >= 3


def test_a_feasible_trial_is_better_than_a_cheap_one(whole):
    safe = whole[1][0]
    cheap = safe._replace(
        violations=(0.1, 0.0, 0.0, 0.0),
        scores=(safe.scores[0]._replace(sideslip_peak_deg=0.0),),
    )
    assert cheap.cost < safe.cost
    assert weight_search.find_best([cheap, safe]) is safe


def test_controller_files_are_written_for_the_tuned_controller_and_its_sibling(whole, tmp_path):
    folder, trials = whole
    found = tune.write(PLAN, trials, folder, tmp_path, ['mpcc_no_ca'])
    assert [path.name for path in found.files] == ['mpcc_tuned.yaml', 'mpcc_no_ca_tuned.yaml']
    assert found.summary['best']['cost'] <= found.summary['untuned']['cost']
    tuned, sibling = found.files
    command = 'experiments tune mpcc --seed 3 --trials 3 2 --tracking 0.3'
    assert command in tuned.read_text()
    config = share.path('mpcc_controller', 'config')
    assert parameters.read_file(sibling, config).values['priorities.obstacle'] == 0.0
    assert len((folder / tune.HISTORY).read_text().splitlines()) == 1 + len(trials)
    assert all(path.stat().st_size > 10_000 for path in found.figures)


def test_an_infeasible_untuned_controller_is_reported_as_infeasible(whole, tmp_path, monkeypatch):
    monkeypatch.setenv('COLUMNS', '100')
    _, trials = whole
    broken = trials[0]._replace(violations=(0.19, 0.0, 1.0, 0.15))
    summary = tune.summarise(PLAN, [broken, *trials[1:]])
    assert not summary['untuned']['safe']
    shown = io.StringIO()
    found = tune.Result(summary, [tmp_path], [tmp_path])
    tune.show(found, Console(file=shown))
    text = shown.getvalue()
    assert (
        'untuned: infeasible, min V2O 0.31 m < 0.5 m, not completed, '
        'path tracked to 0.45 m > 0.3 m' in text
    )
    assert 'infeasible' in tune._cost_note([broken, *trials[1:]]).partition('->')[0]
    feasible = tune.Result(tune.summarise(PLAN, trials), [tmp_path], [tmp_path])
    tune.show(feasible, Console(file=io.StringIO()))
    assert feasible.summary['untuned']['violated'] == []


def test_the_history_shows_every_trial_and_cuts_none_off(whole):
    _, trials = whole
    dear = trials[1]._replace(
        violations=(0.0,) * 4, scores=(trials[1].scores[0]._replace(sideslip_peak_deg=40.0),)
    )
    shown = [trials[0], dear, *trials[2:]]
    ax = Figure().add_subplot()
    tuning_figure._history(ax, shown, weight_search.find_best(shown))
    drawn = {line.get_label(): line for line in ax.get_lines()}
    costs = {trial.cost for trial in shown}
    points = {*drawn['feasible'].get_ydata(), *drawn['infeasible'].get_ydata()}
    assert points == costs
    low, high = ax.get_ylim()
    assert low < min(costs) < dear.cost < high
