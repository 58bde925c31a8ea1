"""`mpcc_road` survives emergencies: fixed draws of every family, more and fresh ones each night.

The fixed ones are of the seed of docs/library.md, which nothing is tuned on. About one of 200 is
lost, and which one changes with every change of the controller: so one loss is allowed. `make
check` drives 34, and 15 more where one of these is lost: a fall to 90 % survival fails 95 times in
100, 99.5 % fail 2 times. Each night ten of each family are driven, of which one may be lost: a fall
to 90 % fails 99.8 times in 100, and one of a single family to 50 % fails 98.9 times.
"""

from collections import Counter
from pathlib import Path

import commit_seed
import pytest
from pyarrow import parquet
from scipy import stats

from experiments import cli, drive_row, simulation
from experiments.drive_row import Row
from experiments.families import draw
from experiments.row_runner import TABLE
from mpcc_controller.driving.last_resort import INTERNAL_ERROR
from mpcc_controller.driving.planner import PLAN_TOUCHES

CONTROLLER = 'mpcc_road'
SEED, MOST_LOST = 4000, 1
FIRST, MORE = 34, 15  # draws, and those that decide where one of them is lost
FALLEN, NOTICED = 0.90, 0.95  # survival, and how probable it is to be that it fails the gate
DRAWS_PER_FAMILY = 10  # each night
NIGHTLY = Path(__file__).parents[2] / 'build/nightly'  # the drives are kept: it goes on from there
NIGHTLY_SEED = 'NIGHTLY_SEED'  # environment variable that repeats the draws of a commit
FIRST_SEED = 1000  # those below are for tuning
FRESH_DRAWS, SURVIVED, LEVEL = 100, 0.995, 0.975


def passes(survival):
    """Return how probable it is that the gate passes at a survival of single draws."""
    lost = stats.binom(FIRST, 1 - survival).pmf
    return lost(0) + lost(1) * survival**MORE


def test_a_fall_is_noticed_and_what_is_published_passes():
    assert passes(FALLEN) <= 1 - NOTICED
    assert passes(SURVIVED) > 0.97


@pytest.mark.slow
@pytest.mark.timeout(1800)  # 37 s of processor time
def test_of_few_fixed_draws_at_most_one_is_lost():
    families, lost = [*draw.FAMILIES], {}
    for k in range(FIRST + MORE):
        if k == FIRST and not lost:
            break
        index, place = divmod(k, len(families))
        row = Row(f'{families[place]}:{index}', CONTROLLER, seed=SEED)
        results = drive_row.drive(drive_row.prepare(row))
        if not results['survived']:
            lost[row.scenario] = results['lost_by']
        assert len(lost) <= MOST_LOST, lost


def test_before_a_closed_road_the_brakes_stop_the_car_and_not_the_steering():
    """Of a seed for tuning: with the friction that is believed at first it could not stop."""
    setup = drive_row.prepare(Row('closed_road:36', CONTROLLER, seed=650))
    results = drive_row.drive(setup)
    assert (results['survived'], results['stopped']) == (True, True)
    reasons = {step.record.decision.reason for step in simulation.steps(setup)}
    assert PLAN_TOUCHES in reasons
    assert INTERNAL_ERROR not in reasons


def survival(folder, draws, seed):
    """Drive the first draws of every family; return the family of each and whether it survived."""
    options = ['--draws', str(draws), '--seed', str(seed), '--controller', CONTROLLER]
    cli.main(['library', *options, '--out', str(folder)])
    rows = parquet.read_table(folder / TABLE, columns=['family', 'survived']).to_pylist()
    assert len(rows) == draws * len(draw.FAMILIES)
    return [(row['family'], row['survived']) for row in rows]


@pytest.mark.nightly
@pytest.mark.timeout(3600)
def test_of_ten_fixed_draws_of_each_family_at_most_one_is_lost():
    driven = survival(NIGHTLY / 'fixed', DRAWS_PER_FAMILY, SEED)
    lost = Counter(family for family, survived in driven if survived is not True)
    assert max(lost.values(), default=0) <= MOST_LOST, lost


@pytest.mark.nightly
@pytest.mark.timeout(4 * 3600)
def test_of_fresh_draws_no_more_are_lost_than_the_published_share_explains():
    """By chance it fails one time in 40."""
    seed = FIRST_SEED + commit_seed.seed(NIGHTLY_SEED) % 2**31
    print(f'{NIGHTLY_SEED}={seed - FIRST_SEED} repeats these draws')
    driven = survival(NIGHTLY, FRESH_DRAWS, seed)
    most = int(stats.binom.ppf(LEVEL, len(driven), 1 - SURVIVED))
    assert sum(survived is not True for _, survived in driven) <= most
