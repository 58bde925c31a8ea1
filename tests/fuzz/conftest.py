"""How much is fuzzed: FUZZ_EXAMPLES per test, a seeded few unless set. See docs/faults.md."""

import os
import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings

sys.path.insert(0, str(Path(__file__).parent))
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
EXAMPLES = int(os.environ.get('FUZZ_EXAMPLES', '8'))
settings.register_profile(
    'fuzz',
    max_examples=EXAMPLES,
    deadline=None,
    derandomize='FUZZ_EXAMPLES' not in os.environ,
    database=None,
    phases=(Phase.generate,),  # a failure is told at once: to shrink batches takes minutes
    suppress_health_check=list(HealthCheck),
)
COUNTED = {}


@pytest.fixture(scope='session')
def count():
    """Return a function that counts inputs; the sum is printed at the end."""

    def one(test, inputs=1):
        COUNTED[test] = COUNTED.get(test, 0) + inputs

    return one


def pytest_terminal_summary(terminalreporter):
    if COUNTED:
        terminalreporter.write_line(f'fuzzed inputs: {sum(COUNTED.values())}')
