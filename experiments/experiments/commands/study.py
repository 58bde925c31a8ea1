"""The paper's comparison over distributions of runs, in process: tables, figures, claims."""

import argparse
from pathlib import Path

from rich.console import Console

from bags.errors import BagError

HELP = 'distributions, ablation, limit speeds, claims of the paper, demand of the task'
PARTS = ('distributions', 'ablation', 'limit', 'claims', 'demand')
OUT = Path('paper', 'study')


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of `experiments study`."""
    parser.add_argument('part', choices=PARTS, help='what is studied')
    parser.add_argument(
        '--out', type=Path, default=OUT, metavar='DIR', help=f'receives the tables (default: {OUT})'
    )
    parser.add_argument('--runs', type=int, metavar='N', help='paired runs (limit: per probe)')
    parser.add_argument(
        '--cause-runs', type=int, metavar='N', help='claims: runs of every switch (default: --runs)'
    )
    parser.add_argument(
        '--sweep-runs', type=int, metavar='N', help='ablation: runs per speed and clearance'
    )
    parser.add_argument('--jobs', type=int, metavar='N', help='processes (default: one per core)')
    parser.add_argument('--quick', action='store_true', help='few runs, to see that it works')
    parser.add_argument(
        '--tuned',
        action='append',
        type=Path,
        default=[],
        metavar='FILE',
        help='a tuned controller as a further row of ablation and limit; may be given several '
        'times (default: every *_tuned.yaml in mpcc_controller/config)',
    )
    parser.add_argument(
        '--role',
        action='append',
        default=[],
        metavar='ROLE=C',
        help='who plays mpcc, mpcc_no_ca or frenet: a name or a YAML file',
    )
    parser.add_argument(
        '--row',
        action='append',
        default=[],
        metavar='NAME',
        help='limit: only this row; may be given several times (default: all)',
    )
    parser.add_argument(
        '--cache', type=Path, metavar='DIR', help='keeps drives (default: beside the solvers)'
    )


def run(chosen: argparse.Namespace) -> int:
    """Study one part; 0 when it was written. Raises BagError."""
    # the cores take a second to load: only who studies waits for them
    from experiments.progress import CountProgress
    from experiments.study import parts
    from experiments.study.drives import Drives

    roles = dict(_role(text) for text in chosen.role)
    console = Console()
    with CountProgress(console) as bars, Drives(chosen.jobs, bars.show, chosen.cache) as drives:
        written = parts.run(
            chosen.part,
            drives,
            chosen.out,
            chosen.runs,
            chosen.quick,
            chosen.tuned,
            roles,
            chosen.cause_runs,
            chosen.sweep_runs,
            chosen.row,
        )
    console.print(f'{drives.driven} drives made, the others were kept from before')
    for path in written:
        console.print(str(path), markup=False, highlight=False, soft_wrap=True)
    return 0


def _role(text):
    role, equals, controller = text.partition('=')
    if not equals or not controller:
        raise BagError(f'--role {text}: must be ROLE=CONTROLLER')
    return role, controller
