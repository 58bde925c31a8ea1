"""Does `mpcc_road` survive 99.5 % of fresh nominal emergencies? 100 draws of each family.

    python tests/closed_loop/nightly_survival.py --out DIR

Every commit draws others, and NIGHTLY_SEED=N draws those of another commit again. More losses than
99.5 % explain by chance (one time in 40) give the exit code 1. The drives are kept as those of
`experiments library`: the same command goes on where it was interrupted.
"""

import argparse
import sys
from pathlib import Path

from pyarrow import parquet
from scipy import stats

from experiments import cli
from experiments.families import draw
from experiments.row_runner import TABLE

sys.path.insert(0, str(Path(__file__).parents[1] / 'helpers'))
import commit_seed

NAME = 'NIGHTLY_SEED'
FIRST_SEED = 1000  # those below are for tuning
DRAWS = 100  # per family
SURVIVED = 0.995
LEVEL = 0.975


def most_losses(drives: int) -> int:
    """Return the largest number of losses that a share of SURVIVED explains."""
    return int(stats.binom.ppf(LEVEL, drives, 1 - SURVIVED))


def judge(folder: Path, wanted: int) -> int:
    """Print how many drives of a table were lost; return 1 if too many, or some are missing."""
    survived = parquet.read_table(folder / TABLE, columns=['survived'])['survived'].to_pylist()
    losses, most = len(survived) - survived.count(True), most_losses(wanted)
    print(f'{losses} of {len(survived)} drives lost or without a result; at most {most} may be')
    return int(len(survived) < wanted or losses > most)


def main() -> int:
    """Drive, judge, and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--out', type=Path, required=True, metavar='DIR')
    parser.add_argument('--draws', type=int, default=DRAWS, metavar='N', help='per family')
    options = parser.parse_args()
    seed = FIRST_SEED + commit_seed.seed(NAME) % 2**31
    print(f'{NAME}={seed - FIRST_SEED} repeats these draws')
    draws = ['--draws', str(options.draws), '--seed', str(seed)]
    cli.main(['library', *draws, '--controller', 'mpcc_road', '--out', str(options.out)])
    return judge(options.out, options.draws * len(draw.FAMILIES))


if __name__ == '__main__':
    sys.exit(main())
