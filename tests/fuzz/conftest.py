"""The amount of fuzzing: FUZZ_EXAMPLES per test, by default a few. See docs/faults.md."""

import os

from hypothesis import HealthCheck, Phase, settings

settings.register_profile(
    'fuzz',
    max_examples=int(os.environ.get('FUZZ_EXAMPLES', '8')),
    deadline=None,
    database=None,
    phases=(Phase.generate,),  # a failure is reported at once: shrinking batches takes minutes
    suppress_health_check=list(HealthCheck),
)
