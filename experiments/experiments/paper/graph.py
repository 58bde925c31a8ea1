"""Both experiments of the paper through the node graph, and their figures from the bags."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from bags.errors import BagError
from bags.figures import frame_distance_figure
from bags.report.comparison import compare_bags, show_comparison
from experiments.configuration import inputs
from experiments.configuration.inputs import KPH
from experiments.run import batch
from experiments.study import tables
from experiments.study.case import Case

CIRCLE, CIRCLE_CONTROLLER = 'circle_20m', 'mpcc_no_ca'
SHEET = 'double_lane_change'
TIME_LIMIT_S = 600.0
SCENARIO_FILE = 'scenario.yaml'
RUN_FILE = 'run.json'


class Driven(NamedTuple):
    """Runs of the double lane change, and where their figures are."""

    metrics: dict[str, dict[str, Any]]  # by controller, those of comparison.json
    figures: list[Path]


def circle(out: Path, bags: Path, console: Console) -> dict[str, Any]:
    """Drive experiment 1 without collision avoidance; return what `bags distances` measured.

    The bag goes to `bags`, figure and numbers to `out`/circle_20m. Raises BagError.
    """
    (bag,) = _driven(CIRCLE, [CIRCLE_CONTROLLER], bags, [], console)
    return frame_distance_figure.write_from_bag(bag, out / CIRCLE).values


def double_lane_change(chosen: Sequence[Case], out: Path, bags: Path, console: Console) -> Driven:
    """Drive one draw of experiment 2 with several controllers; it is the same for all of them.

    The bags go to `bags`; scenario, numbers and figures to `out`/double_lane_change. Raises
    BagError.
    """
    first = chosen[0]
    scn = inputs.load_scenario(first.scenario, first.speed_kph / KPH)
    folder = out / SHEET
    folder.mkdir(parents=True, exist_ok=True)
    # the same draw as a person would set it up by hand
    file = folder / SCENARIO_FILE
    file.write_text(scn.text)
    settings = [
        f'plant.friction={scn.friction * first.grip!r}',
        f'controller.solver.tolerance={first.tolerance!r}',
    ]
    controllers = [one.controller for one in chosen]
    (folder / RUN_FILE).write_text(
        tables.dumped({'controllers': controllers, 'speed_kph': first.speed_kph, 'set': settings})
    )
    made = _driven(str(file), controllers, bags, settings, console)
    found = compare_bags(made, folder)
    show_comparison(found, console)
    return Driven(found.values['runs'], found.figures)


def _driven(scenario, controllers, bags, settings, console):
    """Make the runs and return their bags; BagError when one of them did not complete."""
    plan = batch.Batch(scenario, controllers, 'lockstep', bags, settings, TIME_LIMIT_S)
    _, outcomes = batch.run_controllers(plan, console)
    for outcome in outcomes:
        if not outcome.completed:
            raise BagError(f'{outcome.controller}: {outcome.message}')
    return [outcome.bag for outcome in outcomes]
