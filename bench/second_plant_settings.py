"""The study over settings with the multi-body model of CommonRoad as the only plant.

`python bench/second_plant_settings.py --out build/second_plant [--count 300] [--seed 1]` draws and
drives settings by the preregistered file, in which the plant alone is another one, writes the
tables, and prints how many settings come to each level. An interrupted run goes on.
"""

import argparse
import re
import sys
from pathlib import Path

from rich.console import Console

from experiments.settings import preregistration, run_settings
from vehicle_plant.parameters import MULTI_BODY_CAR

# the dimensions of the plant: the model has no rear tyres and no springs of its own choice
ONLY = {'car': MULTI_BODY_CAR, 'rear_cornering': '1.0', 'roll_share': '0.5'}
PLAN = 'settings_study_second_plant.yaml'


def with_second_plant(text: str) -> str:
    """Return the text of a preregistered file with the second plant as its only one."""
    for name, value in ONLY.items():
        text, found = re.subn(
            rf'^(  {name}: \{{choice: )\[.*?\]', rf'\g<1>[{value}]', text, flags=re.M
        )
        if found != 1:
            raise ValueError(f'dimensions.{name}: is in the file {found} times')
    return text


def main() -> int:
    """Run the study; return its exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--out', type=Path, required=True, help='folder of drives and tables')
    parser.add_argument('--count', type=int, default=300, help='settings')
    parser.add_argument('--seed', type=int, default=1, help='of the draws')
    parser.add_argument('--jobs', type=int, default=2, help='processes')
    parser.add_argument('--limit', type=float, default=120.0, help='s of wall time of a drive')
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    plan = options.out / PLAN
    plan.write_text(with_second_plant(preregistration.load().text))
    request = run_settings.Request(
        options.out, options.count, options.seed, options.jobs, options.limit, plan
    )
    return run_settings.run(request, Console())


if __name__ == '__main__':
    sys.exit(main())
