"""Random scenarios: no traceback, no hang, valid commands, and the right verdict.

60 draws of a fixed series, so that a failure is due to the change under test. A failure names the
seed and the number of every draw with a finding. Another series, or a longer one:

    RANDOM_SEED=7 RANDOM_SCENARIOS=1000 python -m pytest tests/closed_loop/test_random_scenarios.py

One draw of it again, with its scenario file and its report in a folder:

    python tests/closed_loop/drive_draws.py --seed 7 --only 417 --keep build/draw_417
"""

import os

import pytest
import random_scenarios
from draw_driver import LIMIT_S, Driver

DRAWS = int(os.environ.get('RANDOM_SCENARIOS', '60'))
SEED = int(os.environ.get('RANDOM_SEED', random_scenarios.SEED))
# share of runs that the independent evaluation may leave undecided, since they end near the finish
# line: about 0.1 of them, and 0.25 of 60 is improbable
UNSURE = 0.25


@pytest.fixture
def driver():
    one = Driver(SEED)
    yield one
    one.end()


@pytest.mark.slow
@pytest.mark.timeout(10.0 * LIMIT_S)
def test_random_scenarios_have_no_findings(driver):
    results = [driver.drive(index) for index in range(DRAWS)]
    findings = [
        f'drive_draws.py --seed {SEED} --only {index}: {finding}'
        for index, result in enumerate(results)
        for finding in result['findings']
    ]
    assert not findings, '\n'.join(findings)
    # an undecided evaluation finds nothing: this must stay rare
    unsure = [index for index, result in enumerate(results) if result['unsure']]
    assert len(unsure) <= UNSURE * DRAWS, f'seed {SEED}: undecided draws {unsure}'
