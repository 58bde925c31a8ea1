"""Compare the controllers over many paired runs in process: tables, figures, claims.

The parts: distributions of every metric, ablation of single factors, limit speeds, claims of the
paper, demand of the task; and drives of many settings, a random choice of what the paper does not
print each, the decisions on them, one of them alone, the search for one that shows the whole
picture of the paper, the tuned version of the baseline, the tables of the pages, and the published
claims computed again from the rows that are kept with them.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from bags.command_line import add_out, print_text
from bags.errors import BagError
from experiments.commands import add_dask, add_jobs, add_list, add_time_limit, positive_count
from msgs_yaml.strict_yaml import closest

HELP = 'distributions, ablation, limit speeds, claims of the paper, demand, many settings'
EXAMPLE = 'experiments study distributions --quick --runs 10'
PARTS = (
    *('distributions', 'ablation', 'limit', 'claims', 'demand'),
    *('settings', 'decide', 'setting', 'exists', 'baseline', 'result', 'recompute'),
)
DECISIONS = ('decide', 'setting', 'exists', 'baseline', 'result', 'recompute')
OUT = Path('paper', 'study')
DECIDED = Path('paper', 'settings')
SETTINGS, QUICK_SETTINGS = 10_000, 12
QUICK_RUNS = {'distributions': 6, 'ablation': 2, 'limit': 4, 'claims': 6}
QUICK_LIMIT_KPH = (70.0, 100.0, 130.0)
QUICK_SWEEP = {'sweep_runs': 1, 'speeds_kph': (65.0, 75.0, 85.0), 'clearances_m': (0.5,)}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `experiments study`."""
    parser.add_argument('part', choices=PARTS, help='the part of the study')
    text = 'decide, exists, baseline, result: what `experiments study settings` wrote; several are '
    text += 'decided as one by decide, each alone by result; recompute: the published tables'
    parser.add_argument('folders', nargs='*', type=Path, metavar='DIR', help=text)
    add_out(parser, OUT, 'the tables')
    parser.add_argument(
        '--runs', type=int, metavar='N', help='paired runs (default: 60; limit: 20 per speed)'
    )
    parser.add_argument(
        '--cause-runs', type=int, metavar='N', help='claims: runs of every switch (default: --runs)'
    )
    parser.add_argument(
        '--sweep-runs',
        type=int,
        metavar='N',
        help='ablation: runs per speed and clearance (default: 20)',
    )
    add_jobs(parser, 'the result')
    parser.add_argument('--quick', action='store_true', help='few runs, to see that it works')
    text = 'a tuned controller as a further row of ablation and limit'
    default = 'every *_tuned.yaml in mpcc_controller/config'
    add_list(parser, '--tuned', text, default, type=Path, metavar='FILE')
    parser.add_argument(
        '--role',
        action='append',
        default=[],
        metavar='ROLE=C',
        help='controller in the role mpcc, mpcc_no_ca or frenet: a name or a YAML file',
    )
    add_list(parser, '--row', 'limit: only this row', 'all', metavar='NAME')
    parser.add_argument(
        '--cache', type=Path, metavar='DIR', help='keeps results (default: beside the solvers)'
    )
    parser.add_argument(
        '--count',
        type=positive_count,
        default=SETTINGS,
        metavar='N',
        help=f'settings: how many (default: {SETTINGS:,}; {QUICK_SETTINGS} with --quick)',
    )
    parser.add_argument(
        '--seed', type=int, default=1, metavar='S', help='settings: of the draws (default: 1)'
    )
    add_dask(parser, 'settings: ')
    add_time_limit(parser, '--limit', 600.0, 'settings: a drive fails')
    text = 'settings: other ranges and cars than those of experiments/config/settings_study.yaml'
    parser.add_argument('--plan', type=Path, metavar='FILE', help=text)
    text = 'settings: all controllers only where P1 to P3 can be met; says nothing below P3'
    parser.add_argument('--screen', action='store_true', help=text)
    text = 'settings: seed, count and screening of a run of the preregistration'
    parser.add_argument('--preregistered', metavar='RUN', help=text)
    text = (
        'result: a page whose blocks about the study, <!-- who avoids --> to <!-- /who avoids -->,'
    )
    parser.add_argument(
        '--page',
        action='append',
        default=[],
        dest='pages',
        type=Path,
        metavar='FILE',
        help=f'{text} are written anew; may be repeated',
    )
    parser.add_argument('--number', type=int, metavar='N', help='setting: its number')
    parser.add_argument(
        '--trials', type=positive_count, metavar='N', help='exists, baseline: sets that are tried'
    )


def run(options: argparse.Namespace) -> int:
    """Run one part; 0 when it was written. Raises BagError."""
    if options.part == 'settings':
        return _run_settings(options)
    if options.part in DECISIONS:
        return _run_decision(options)
    # imported late: simulation and controllers take a second to load
    from experiments.progress import CountProgress
    from experiments.study.runner import Runner

    roles = dict(_parse_role(text) for text in options.role)
    console = Console()
    with (
        CountProgress(console) as progress,
        Runner(options.jobs, progress.show, options.cache) as runner,
    ):
        files = run_part(options, runner, roles)
    console.print(f'{runner.simulated} runs simulated, the others were cached')
    for path in files:
        print_text(console, str(path))
    return 0


def _run_settings(options):
    from experiments.settings import run_settings

    if options.out == OUT:
        raise BagError('settings: needs --out DIR, where drives are kept and the table is written')
    if len(options.tuned) > 1:
        raise BagError(f'settings: takes one --tuned FILE, has {len(options.tuned)}')
    if options.seed < 0:
        raise BagError(f'--seed: is {options.seed}; allowed 0 or more')
    count = min(options.count, QUICK_SETTINGS) if options.quick else options.count
    request = run_settings.Request(
        options.out,
        count,
        options.seed,
        options.jobs,
        options.limit,
        plan=options.plan,
        tuned=options.tuned[0] if options.tuned else None,
        is_screened=options.screen,
        dask=options.dask,
    )
    if options.preregistered:
        request = run_settings.preregistered(request, options.preregistered)
    return run_settings.run(request, Console())


def _run_decision(options):
    from experiments.settings_analysis import run_decision

    if options.out == OUT:
        options.out = DECIDED
    arguments = {name: getattr(options, name) for name in run_decision.Request._fields}
    return run_decision.run(run_decision.Request(**arguments), Console())


def _parse_role(text):
    role, equals, controller = text.partition('=')
    if not equals or not controller:
        raise BagError(f'--role {text}: must be ROLE=CONTROLLER')
    return role, controller


def run_part(options: argparse.Namespace, runner: Any, roles: Mapping[str, str]) -> list[Path]:
    """Run one part with a Runner and return its files. Raises BagError."""
    from experiments.study import (
        ablation,
        claim_evaluation,
        demand,
        limit,
        metric_distributions,
        variants,
    )
    from experiments.study.metric_distributions import Sweep

    part, out, quick = options.part, options.out, options.quick
    if part == 'demand':  # simulates nothing
        return demand.run(out)
    if options.row and part != 'limit':
        raise BagError(f'--row is for the limits only, not for {part}')
    full_runs = limit.RUNS if part == 'limit' else metric_distributions.RUNS
    default_runs = QUICK_RUNS[part] if quick else full_runs
    runs = default_runs if options.runs is None else options.runs
    speeds = metric_distributions.SPEEDS_KPH[:1] if quick else metric_distributions.SPEEDS_KPH
    compared = variants.role_variants(roles)
    if part == 'distributions':
        return metric_distributions.run(runner, out, Sweep(compared, runs, speeds)).files
    if part == 'limit':
        rows = [*compared, *variants.further_variants(roles, options.tuned)]
        if not quick:
            rows += variants.switched_variants(roles)
        probed = QUICK_LIMIT_KPH if quick else limit.SPEEDS_KPH
        sweep = Sweep(_select_rows(options.row, rows), runs, probed)
        return limit.run(runner, out, sweep)
    if part == 'claims':
        return claim_evaluation.run(runner, out, runs, options.cause_runs, speeds, roles).files
    sweep = QUICK_SWEEP if quick else {}
    if options.sweep_runs:
        sweep = sweep | {'sweep_runs': options.sweep_runs}
    return ablation.run(runner, out, runs, tuned=options.tuned, roles=roles, **sweep).files


def _select_rows(names, variants):
    if not names:
        return variants
    known = {variant.name: variant for variant in variants}
    unknown = [name for name in names if name not in known]
    if unknown:
        hint = closest(unknown[0], known)
        raise BagError(f'no row {unknown[0]!r}; there are {", ".join(known)}{hint}')
    return [known[name] for name in dict.fromkeys(names)]
