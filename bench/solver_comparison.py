"""How fast and how good are the solvers, on the problems of closed loops?

    .venv/bin/python bench/solver_comparison.py [--quick] [--passes 3] [--interpreted] [--out bench]

Writes solver.md and solver.json into the folder --out. --problems FILE keeps the problems, so that
a run can be repeated on the same ones, by this or another version of the solvers.
"""

import argparse
from pathlib import Path

import active_limits
import closed_loops
import interleaved_runs
import machine
import one_step
import problems
import scaling
import solver_report
import solver_variants
import start_up
import summary
import tables
from assessment import Assessment, Assessor
from problems import Problems
from rich.console import Console
from rich.progress import Progress
from solver_variants import Variant

from mpcc_controller.parameters import ControllerParams
from mpcc_controller.problem import mpcc_formulation, ocp
from stage_solver.stage_problem import StageProblem

FULL_PASSES, QUICK_PASSES = 3, 2
COLD_EVERY = 5  # problems
WIDTH = 165  # characters of the tables, also where there is no terminal


def main() -> None:
    """Measure, print the tables, and write them."""
    arguments = parse_arguments()
    console = Console()
    console.width = max(console.width, WIDTH)
    facts = machine.named() | {'runs on': machine.pin()}
    passes = arguments.passes or (QUICK_PASSES if arguments.quick else FULL_PASSES)
    params = closed_loops.controller_params('mpcc')
    model = params.model
    size = len(params.body.circle_offsets_m), params.surroundings.max_obstacles
    problem = ocp.build(mpcc_formulation.symbolic_ocp(*size), model.horizon, model.step_s)
    chosen = solver_variants.available(params, arguments.interpreted)
    with Progress(console=console) as progress:
        given = problems_of(arguments, problem, progress)
        assessor = Assessor(problem)
        ran, alone = measure(problem, given, params, chosen, passes, progress)
        assessments = assess(assessor, ran, progress)
        rows = summary.summarize(ran, assessments, params.solver.fallback_limit_s)
        alone_rows = summary.alone(alone, assessments)
        active = active_limits.find_active(problem, given, *size)
        demanding = active_limits.demanding(active)
        text_tables = [
            solver_report.activity(given, active, demanding),
            solver_report.timing(rows),
            solver_report.starts(rows),
            solver_report.alone(alone_rows),
            solver_report.slowest(rows),
        ]
        for text_table in text_tables:
            tables.show(console, text_table)
        figures = {'passes': passes, 'active_share': float(demanding.mean()), 'alone': alone_rows}
        if not arguments.quick:
            for part in (scaling, start_up, one_step):
                text_table, figures[part.__name__] = part.measure(params, progress)
                text_tables.append(text_table)
                tables.show(console, text_table)
    settings = f'{len(given.x0)} problems, {passes} passes'
    arguments.out.mkdir(parents=True, exist_ok=True)
    text = solver_report.as_markdown(facts, settings, text_tables, rows)
    (arguments.out / 'solver.md').write_text(text)
    numbers = solver_report.as_json(facts, len(given.x0), rows, figures)
    (arguments.out / 'solver.json').write_text(numbers)
    console.print(f'written: {arguments.out / "solver.md"}, {arguments.out / "solver.json"}')


def measure(
    problem: StageProblem,
    given: Problems,
    params: ControllerParams,
    chosen: list[Variant],
    passes: int,
    progress: Progress,
) -> tuple[interleaved_runs.Timings, interleaved_runs.Timings]:
    """Build the solvers and their warm starts, then measure them in turns, and each alone."""
    solvers = solver_variants.make_solvers(
        problem, progress.track(chosen, description='compiling'), params
    )
    tasks = {
        label: interleaved_runs.tasks(problem, given, params.fallback, one, COLD_EVERY)
        for label, one in progress.track(solvers.items(), description='making warm starts')
    }
    total = passes * len(next(iter(tasks.values())))
    bar = progress.add_task('solving, the solvers in turn', total=total)
    in_turn = interleaved_runs.run(solvers, tasks, passes, lambda: progress.advance(bar))
    bar = progress.add_task('solving, each alone', total=total * len(solvers))
    alone = interleaved_runs.run_alone(solvers, tasks, passes, lambda: progress.advance(bar))
    return in_turn, alone


def problems_of(arguments, problem: StageProblem, progress: Progress) -> Problems:
    """Return the problems of the file, or those of the loops, kept where a file is named."""
    if arguments.problems is not None and arguments.problems.exists():
        return problems.load(arguments.problems, problem)
    driven = closed_loops.QUICK if arguments.quick else closed_loops.FULL
    given = problems.record(progress.track(driven, description='driving'))
    if arguments.problems is not None:
        problems.save(given, arguments.problems)
    return given


def assess(
    assessor: Assessor, ran: interleaved_runs.Timings, progress: Progress
) -> dict[str, list[Assessment]]:
    """Return the assessment of every answer."""
    bar = progress.add_task('assessing', total=sum(map(len, ran.answers.values())))
    assessments = {}
    for label, answers in ran.answers.items():
        assessments[label] = []
        for task, answer in zip(ran.tasks[label], answers):
            assessments[label].append(assessor.assess(task, answer))
            progress.advance(bar)
    return assessments


def parse_arguments() -> argparse.Namespace:
    """Return the arguments of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--quick', action='store_true', help='few problems, no scaling tables')
    parser.add_argument('--passes', type=int, help='how often each problem is solved')
    parser.add_argument('--interpreted', action='store_true', help='also without compiled code')
    parser.add_argument('--problems', type=Path, help='file of the problems; made when missing')
    parser.add_argument('--out', type=Path, default=Path(__file__).parent, help='folder to write')
    arguments = parser.parse_args()
    if arguments.passes is not None and arguments.passes < 1:
        parser.error('--passes must be 1 or more')
    return arguments


if __name__ == '__main__':
    main()
