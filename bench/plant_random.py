"""Random command sequences on random friction: finite, bounded, every one of them.

`python bench/plant_random.py [--runs 10000] [--first 0] [--seconds 3] [--processes 1]`; ends with
exit code 1 and the seeds when a sequence breaks a bound.
"""

import argparse
import sys
import time
from functools import cache, partial
from multiprocessing import Pool

from vehicle_plant import parameters
from vehicle_plant.manoeuvres import procedure, settings, verification

CHUNK = 50


@cache
def case() -> procedure.Case:
    """Return the car; the sequences bring their own friction."""
    return procedure.Case(parameters.load(), 1.0, settings.load())


def drive(seed: int, seconds: float) -> tuple[int, list[str]]:
    """Return the seed and what its sequence broke."""
    return seed, verification.drive_random_run(seed, case(), seconds)


def main() -> int:
    """Drive; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--runs', type=int, default=10000, help='number of sequences')
    parser.add_argument('--first', type=int, default=0, help='seed of the first one')
    parser.add_argument('--seconds', type=float, default=3.0, help='length of each')
    parser.add_argument('--processes', type=int, default=1)
    options = parser.parse_args()
    begin, failed = time.perf_counter(), 0
    seeds = range(options.first, options.first + options.runs)
    with Pool(options.processes) as pool:
        one = partial(drive, seconds=options.seconds)
        for seed, broken in pool.imap(one, seeds, chunksize=CHUNK):
            failed += bool(broken)
            for line in broken:
                print(f'seed {seed}: {line}', flush=True)
    elapsed = time.perf_counter() - begin
    print(f'{options.runs} sequences of {options.seconds:g} s, {failed} failed, {elapsed:.0f} s')
    return 1 if failed else 0


if __name__ == '__main__':
    sys.exit(main())
