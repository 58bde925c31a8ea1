"""`experiments paper`: both experiments, distributions and claims of the paper from scratch.

The claims in docs/one_point.md are a block between two comments, generated from claims.json in a
short form: medians without ranges, no shares and no causes; claims.md has these.
"""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from bags.command_line import print_paths
from bags.errors import BagError
from bags.figures import frame_distance_figure
from bags.report.comparison import compare_bags, show_comparison
from bags.run import load
from experiments import page_block
from experiments.configuration import inputs
from experiments.configuration.inputs import KPH
from experiments.paper import operating_point
from experiments.progress import CountProgress
from experiments.run import run_and_compare
from experiments.study import claim_evaluation, metric_distributions, tables, variants
from experiments.study.metric_distributions import POINT_KPH, Sweep
from experiments.study.run_spec import RunSpec
from experiments.study.runner import Runner

# controllers of the comparison: weights tuned with equal objective, budget and seed
ROLES = {name: f'{name}_tuned' for name in variants.CONTROLLERS}
ORDER = ('mpcc_no_ca', 'mpcc', 'frenet')  # of drawing: a later controller covers an earlier one
BAGS, STUDY, DOUBLE_LANE_CHANGE = 'bags', 'study', 'double_lane_change'
CIRCLE, CIRCLE_CONTROLLER = 'circle_20m', 'mpcc_no_ca'
SCENARIO_FILE, RUN_FILE = 'scenario.yaml', 'run.json'
TIME_LIMIT_S = 600.0
COMMAND, QUICK = 'experiments paper', ' --quick'
RUNS, QUICK_RUNS = metric_distributions.RUNS, 6
CAUSE_RUNS, QUICK_CAUSE_RUNS = 10, 2
BLOCK = 'claims'  # of the page
BLOCK_COLUMNS = {
    'claim': 'claim',
    'paper': 'paper',
    'ours': 'ours: median',
    'verdict': 'verdict',
}
RANGE = re.compile(r' \[[^],]+, [^],]+\]')
COLOURS = {'reproduced': 'green', 'partly': 'yellow', 'not': 'red'}  # of verdicts; else dim


class Reproduction(NamedTuple):
    """The result of `experiments paper`."""

    claims: Path  # claims.json
    rows: list[dict]
    figures: list[Path]


class NodeGraphRuns(NamedTuple):
    """Runs of the double lane change, and their figures."""

    metrics: dict[str, dict[str, Any]]  # by controller, those of comparison.json
    figures: list[Path]


def reproduce(out: Path, quick: bool, jobs: int | None, console: Console) -> Reproduction:
    """Write everything into the folder `out`, with few runs if `quick`. Raises BagError."""
    runs, cause_runs = (QUICK_RUNS, QUICK_CAUSE_RUNS) if quick else (RUNS, CAUSE_RUNS)
    speeds = metric_distributions.SPEEDS_KPH[:1] if quick else metric_distributions.SPEEDS_KPH
    bags, command = out / BAGS, COMMAND + (QUICK if quick else '')
    console.print('1/4 the operating point, in process', style='bold')
    operating_point.write(out)
    console.print(f'2/4 distributions of {runs} paired runs and their causes', style='bold')
    with CountProgress(console) as progress, Runner(jobs, progress.show) as runner:
        compared = variants.role_variants(ROLES)
        paired = metric_distributions.run(
            runner, out / STUDY, Sweep(compared, runs, speeds), command
        )
        claims = claim_evaluation.run(runner, out, runs, cause_runs, speeds, ROLES, command=command)
    console.print('3/4 experiment 2 through the node graph, as the median run', style='bold')
    specs = [paired.median_spec(role) for role in ORDER]
    driven = run_double_lane_change(specs, out, bags, console)
    _check_agreement(paired, driven)
    console.print('4/4 experiment 1 through the node graph', style='bold')
    run_circle(out, bags, console)
    return Reproduction(out / f'{claim_evaluation.STEM}.json', claims.rows, driven.figures)


def run_circle(out: Path, bags: Path, console: Console) -> dict[str, Any]:
    """Run experiment 1 without collision avoidance; return the values of `bags distances`.

    The bag goes to `bags`, figure and numbers to `out`/circle_20m. Raises BagError.
    """
    (bag,) = _run_controllers(CIRCLE, [CIRCLE_CONTROLLER], bags, [], console)
    drive = load(bag).drive
    return frame_distance_figure.write_frame_distances(drive, out / CIRCLE).values


def run_double_lane_change(
    specs: Sequence[RunSpec], out: Path, bags: Path, console: Console
) -> NodeGraphRuns:
    """Run one draw of experiment 2, the same for all controllers.

    The bags go to `bags`; scenario, numbers and figures to `out`/double_lane_change. Raises
    BagError.
    """
    first = specs[0]
    scn = inputs.load_scenario(first.scenario, first.speed_kph / KPH)
    folder = out / DOUBLE_LANE_CHANGE
    folder.mkdir(parents=True, exist_ok=True)
    # scenario file and settings repeat the draw by hand
    file = folder / SCENARIO_FILE
    file.write_text(scn.text)
    settings = [
        f'plant.friction={scn.friction * first.grip!r}',
        f'controller.solver.tolerance={first.tolerance!r}',
    ]
    controllers = [spec.controller for spec in specs]
    (folder / RUN_FILE).write_text(
        tables.dump_json(
            {'controllers': controllers, 'speed_kph': first.speed_kph, 'set': settings}
        )
    )
    recorded = _run_controllers(str(file), controllers, bags, settings, console)
    comparison = compare_bags(recorded, folder)
    show_comparison(comparison, console)
    return NodeGraphRuns(comparison.values['runs'], comparison.figures)


def _run_controllers(scenario, controllers, bags, settings, console):
    """Return the bags of the runs; BagError when one of them was not completed."""
    runs = run_and_compare.Request(
        scenario, controllers, 'lockstep', bags, settings, TIME_LIMIT_S, overwrite=True
    )
    _, outcomes = run_and_compare.run_controllers(runs, console)
    for outcome in outcomes:
        if not outcome.completed:
            raise BagError(f'{outcome.controller}: {outcome.message}')
    return [outcome.bag for outcome in outcomes]


def _check_agreement(paired, driven):
    """Raise BagError when the node graph and the simulation in process differ."""
    for role in ORDER:
        spec = paired.median_spec(role)
        (record,) = (run for run in paired.records[POINT_KPH][role] if run.spec == spec)
        simulated = operating_point.select(record.metrics)
        recorded = operating_point.select(driven.metrics[spec.controller])
        for deviation in operating_point.find_deviations(spec.controller, simulated, recorded):
            raise BagError(f'node graph and simulation in process differ: {deviation}')


def show(result: Reproduction, console: Console) -> None:
    """Print the claims, the reasons of undecided ones, and the paths of claims and figures."""
    table = Table(title='The claims of the paper', title_justify='left', show_lines=True)
    table.add_column('claim, what the paper says, what comes out here', overflow='fold')
    table.add_column('verdict', no_wrap=True)
    table.add_column('holds in runs', no_wrap=True)
    for row in result.rows:
        verdict = f'[{COLOURS.get(row["verdict"], "dim")}]{row["verdict"]}[/]'
        # brackets are ranges, not markup
        paper, ours = (escape(row[name]) for name in ('paper', 'ours'))
        text = f'[bold]{row["claim"]}[/]\n[dim]paper[/] {paper}\n[dim]ours [/] {ours}'
        table.add_row(text, verdict, escape(row['interval']))
    console.print(table)
    console.print(claim_evaluation.undecided_list(result.rows), markup=False, highlight=False)
    sheet = next(path for path in result.figures if path.suffix == '.png')
    print_paths(console, {'claims': result.claims, 'figures': sheet})


def build_claims_block(file: Path) -> str:
    """Return the text between the comments for a claims.json. Raises BagError."""
    try:
        rows = json.loads(file.read_text())
        point = rows[0]['operating_point']
        lines = [[_cell(row[name]) for name in BLOCK_COLUMNS] for row in rows]
    except (OSError, ValueError, LookupError, TypeError) as error:
        raise BagError(f'{file}: holds no claims: {error}') from None
    table = tables.markdown_table(list(BLOCK_COLUMNS.values()), lines)
    reasons = claim_evaluation.undecided_list(rows)
    return f'\nAt {point}:\n\n{table}\n{reasons}' + ('\n' if reasons else '')


def _cell(text):
    return RANGE.sub('', str(text)).replace('|', r'\|').replace('\n', ' ')


def rewrite_claims_block(file: Path, claims_file: Path) -> None:
    """Replace the text between the comments of a file. Raises BagError."""
    page_block.replace(file, BLOCK, build_claims_block(claims_file))
