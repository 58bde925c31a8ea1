"""`experiments library`: the rows of families or entries are driven; who survived is shown."""

import argparse
import json
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console

from bags.command_line import print_text
from bags.errors import BagError
from experiments import code_version, drive_row, pass_criteria, row_runner
from experiments.configuration import node_config
from experiments.drive_row import SCENARIO_SPEED, Row
from experiments.library import survival_table
from experiments.pool import Pool
from experiments.progress import CountProgress
from scenario_publisher import scenario

SHOWN_LOSSES = 200


def run(
    options: argparse.Namespace, families: Sequence[str], entries: Sequence[str], console: Console
) -> int:
    """Drive what is missing, write the table and show it; return 0 when all is well.

    `options` are those of `experiments library`. 1 when a drive has no result, an expectation of an
    entry is not met, or a family survived less than `at_least`. Raises BagError for unusable input,
    and KeyboardInterrupt after the table of the drives so far was written.
    """
    rows = plan_rows(options, families, entries)
    for name in entries:
        pass_criteria.check_names(scenario.load(name).expect, name)
    # an error in a setting is reported before anything is driven
    for row in {row.controller: row for row in rows}.values():
        drive_row.prepare(row, written='--set {}'.format)
    notes = {'library': json.dumps(vars(options), default=str)}
    with (
        CountProgress(console) as progress,
        Pool(options.jobs, options.dask, code_version.describe) as pool,
    ):
        lines = row_runner.run_rows(rows, options.out, pool, progress, options.time_limit_s, notes)
    is_well = _show(lines, entries, options.at_least, console)
    return 0 if is_well and not any(line['error'] for line in lines) else 1


def plan_rows(
    options: argparse.Namespace, families: Sequence[str], entries: Sequence[str]
) -> list[Row]:
    """Return every row, family by family, draw by draw, controller by controller."""
    controllers = node_config.find_controllers(options.controller or ['mpcc_road'])
    settings = drive_row.as_pairs(options.settings)
    if families and SCENARIO_SPEED in dict(settings):
        raise BagError(f'--set {SCENARIO_SPEED}: families draw their own speeds')
    indices = range(options.first, options.first + options.draws)
    draws = [f'{family}:{index}' for family in families for index in indices]
    return [
        Row(what, controller.name_or_path, settings, options.seed, options.difficulty)
        for what in (*entries, *draws)
        for controller in controllers
    ]


def _show(rows: Sequence[Mapping[str, Any]], entries, at_least, console):
    """Show what came out; return whether every requirement is met."""
    console.print(survival_table.build_table(rows))
    losses = list(survival_table.describe_losses(rows))
    for line in losses[:SHOWN_LOSSES]:
        print_text(console, line)
    if len(losses) > SHOWN_LOSSES:
        print_text(console, f'and {len(losses) - SHOWN_LOSSES:,} more, see the table')
    unmet = []
    if entries:
        outcomes = [
            (f'{row["scenario"]} {row["controller"]}', outcome)
            for row in rows
            for outcome in pass_criteria.judge(scenario.load(row['scenario']).expect, row)
        ]
        unmet = [pair for pair in outcomes if not pair[1].is_met]
        if unmet:
            console.print(pass_criteria.build_table(unmet))
        met = len(outcomes) - len(unmet)
        print_text(console, f'{met} of {len(outcomes)} expectations are met')
    below = [] if at_least is None else survival_table.families_below(rows, at_least)
    for line in below:
        print_text(console, f'less than {at_least:.1%} survived: {line}')
    return not unmet and not below
