"""Record the golden runs again: the reference that `replay-check` compares later versions with."""

import argparse
import os
import shutil
import tempfile
from pathlib import Path

from rich.console import Console

from bags.command_line import add_out

HELP = 'replace the golden recordings by new runs'
EXAMPLE = 'experiments golden'
REFERENCE = Path('bags', 'reference')
# controllers by scenario: those of the paper in its manoeuvre; that of the road where a car cuts in
# and brakes, so that candidates, tracked obstacles and the friction estimate are all at work
DRIVES = {'double_lane_change': ('mpcc', 'mpcc_no_ca', 'frenet'), 'cut_in': ('mpcc_road',)}
TIME_LIMIT_S = 300.0  # of wall time for a run


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments golden`."""
    add_out(parser, REFERENCE, '<scenario>/<controller>/')


def run(options: argparse.Namespace) -> int:
    """Record the golden bags, a bag <scenario>/<controller> each.

    0 when every run was completed; otherwise nothing is replaced. Raises BagError.
    """
    from bags.storage import read
    from experiments.replay import recorded_ticks
    from experiments.run import run_and_compare

    out, console = options.out, Console()
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix='.golden.', dir=out) as folder:
        work = Path(folder)
        for scenario, controllers in DRIVES.items():
            request = run_and_compare.Request(
                scenario, controllers, 'lockstep', work, (), TIME_LIMIT_S, overwrite=True
            )
            if code := run_and_compare.run(request, console):
                return code
        for bag in sorted(work.glob('*/*/metadata.yaml')):
            reduced = recorded_ticks.cut(read.load(bag.parent), work / 'cut' / bag.parent.name)
            final = out / bag.parent.parent.name / bag.parent.name
            # the MCAP file is named after its folder, which moving does not change
            final.parent.mkdir(parents=True, exist_ok=True)
            shutil.rmtree(final, ignore_errors=True)
            reduced.rename(final)
            size = sum(file.stat().st_size for file in final.iterdir())
            console.print(f'{os.path.relpath(final)}: {size / 1000:.0f} kB', highlight=False)
    return 0
