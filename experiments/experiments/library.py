"""`experiments library`: families and entries listed, chosen and driven; who survived, and who not.

Shares have Wilson's interval of 95 %; of the others the cause is told.
"""

import argparse
import inspect
import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pandas
from rich.console import Console
from rich.table import Table

from bags.command_line import print_text, table
from bags.errors import BagError
from experiments import drive_row, pass_criteria, row_runner
from experiments.configuration import node_config
from experiments.drive_row import SCENARIO_SPEED, Row
from experiments.families import draw
from experiments.statistical_inference import wilson_interval
from msgs_yaml.strict_yaml import closest
from scenario_publisher import scenario

SHOWN_LOSSES = 200
ALL = 'all'
ENTRIES = 'entries'  # stands where a family does

Rows = Sequence[Mapping[str, Any]]


def show_catalogue(console: Console) -> int:
    """Print families and entries; return exit code 0."""
    families = {
        name: inspect.getdoc(family).split('.')[0].removeprefix('Return ').split(': ')[0]
        for name, family in draw.LIBRARY.items()
    }
    entries = {name: scenario.load(name).description for name in entries_of_library()}
    for title, members in (('family', families), ('entry', entries)):
        rows = [(name, ' '.join(text.split())) for name, text in members.items()]
        console.print(table((title, ''), rows, left=(title, '')))
    return 0


def entries_of_library() -> list[str]:
    """Return the scenarios that expect something of a run, by name."""
    return [name for name in scenario.available() if scenario.load(name).expect]


def choose(
    families: Sequence[str], with_entries: bool, entries: Sequence[str]
) -> tuple[list[str], list[str]]:
    """Return the families and the entries to be driven.

    Where none is named these are all entries, or all families of emergencies.

    Raises BagError for an unknown one, and for names of the kind that is not driven.
    """
    if with_entries and families:
        raise BagError('--family: --entries drives no family; leave one of both out')
    if entries and not with_entries:
        raise BagError('--entry: goes with --entries')
    if with_entries:
        return [], _known('--entry', entries, entries_of_library())
    return _known('--family', families, list(draw.LIBRARY)) if families else [*draw.FAMILIES], []


def _known(option, chosen, available):
    for name in chosen:
        if name not in available:
            hint = closest(name, available)
            raise BagError(f'{option}: no {name!r}; there are {", ".join(available)}{hint}')
    return list(dict.fromkeys(chosen)) or list(available)


def write_draw(options: argparse.Namespace, console: Console) -> int:
    """Write a draw as a scenario file; return exit code 0. Raises BagError for no such draw.

    `options` are those of `experiments library`.
    """
    which, path = options.draw, options.out
    row = Row(which, '', (), options.seed, options.difficulty)
    if row.draw is None:
        known = ', '.join(draw.LIBRARY)
        raise BagError(f'{which!r} is no draw; allowed FAMILY:INDEX, FAMILY one of {known}')
    scene = draw.draw(*row.draw[:4])
    settings = ' '.join(
        f'--set {role}.{name}={value}'
        for role, values in scene.settings.items()
        for name, value in values.items()
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    how = f'# drive it with: experiments run {path} {settings}\n' if settings else ''
    path.write_text(how + scene.text)
    print_text(console, f'{path}' + (f'; drive it with {settings}' if settings else ''))
    return 0


def run(
    options: argparse.Namespace, families: Sequence[str], entries: Sequence[str], console: Console
) -> int:
    """Drive what is missing, write the table and show it; return 0 when all is well.

    `options` are those of `experiments library`. 1 when a drive has no result, an expectation of an
    entry is not met, or a family survived less than `at_least`. Raises BagError for unusable input,
    and KeyboardInterrupt after the table of the drives so far was written.
    """
    controllers = node_config.find_controllers(options.controller or ['mpcc_road'])
    settings = drive_row.as_pairs(options.settings)
    if families and SCENARIO_SPEED in dict(settings):
        raise BagError(f'--set {SCENARIO_SPEED}: families draw their own speeds')
    indices = range(options.first, options.first + options.draws)
    draws = [f'{family}:{index}' for family in families for index in indices]
    rows = [
        Row(what, controller.name_or_path, settings, options.seed, options.difficulty)
        for what in (*entries, *draws)
        for controller in controllers
    ]
    for name in entries:
        pass_criteria.check_names(scenario.load(name).expect, name)
    # an error in a setting is reported before anything is driven
    for row in {row.controller: row for row in rows}.values():
        drive_row.prepare(row, written='--set {}'.format)
    notes = {'library': json.dumps(vars(options), default=str)}
    with row_runner.driving(options, console) as pool:
        lines = row_runner.run_rows(rows, options.out, pool, options.time_limit_s, notes)
    is_well = _show(lines, entries, options.at_least, console)
    return 0 if is_well and not any(line['error'] for line in lines) else 1


def _show(rows: Rows, entries, at_least, console):
    """Show what came out; return whether every requirement is met."""
    console.print(build_table(rows))
    losses = list(describe_losses(rows))
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
    below = [] if at_least is None else families_below(rows, at_least)
    for line in below:
        print_text(console, f'less than {at_least:.1%} survived: {line}')
    return not unmet and not below


def family_of(row: Mapping[str, Any]) -> str:
    """Return the family of a row, ENTRIES for one that is no draw."""
    return row['family'] or ENTRIES


def counts(rows: Rows) -> dict[tuple[str, str], tuple[int, int]]:
    """Return how many drives survived, and how many have a result, by family and controller.

    Of several families also that of ALL of them.
    """
    kept = ('controller', 'survived', 'error')
    frame = pandas.DataFrame(
        [{'family': family_of(row)} | {n: row[n] for n in kept} for row in rows],
        columns=('family', *kept),
    )
    if frame['family'].nunique() > 1:
        frame = pandas.concat([frame, frame.assign(family=ALL)])
    frame['driven'] = ~frame['error'].astype(bool)
    frame['survived'] = frame['survived'].eq(True) & frame['driven']
    sums = frame.groupby(['family', 'controller'], sort=False)[['survived', 'driven']].sum()
    return {pair: (int(survived), int(driven)) for pair, survived, driven in sums.itertuples()}


def build_table(rows: Rows) -> Table:
    """Return survived of driven per family and controller, with Wilson's interval of 95 %."""
    by_pair = counts(rows)
    families, controllers = (list(dict.fromkeys(pair[k] for pair in by_pair)) for k in (0, 1))
    rows = [
        [family, *(share_cell(*by_pair.get((family, name), (0, 0))) for name in controllers)]
        for family in families
    ]
    return table(['survived', *controllers], rows)


def share_cell(survived: int, driven: int, digits: int = 1) -> str:
    """Return `survived/driven share (interval)` with so many digits of the share, in percent."""
    if not driven:
        return '–'
    low, high = (100 * bound for bound in wilson_interval(survived, driven))
    return f'{survived}/{driven} {survived / driven:.{digits}%} [dim]({low:.0f}–{high:.0f})[/]'


def describe_losses(rows: Rows) -> Iterator[str]:
    """Yield a line for each drive that was lost or failed: which, by whom, and the cause."""
    for row in rows:
        if row['error']:
            yield f'{row["scenario"]} {row["controller"]}: no result: {row["error"]}'
        elif row['survived'] is not True:
            yield f'{row["scenario"]} {row["controller"]}: {row["lost_by"]} ({row["verdict"]})'


def families_below(rows: Rows, share: float) -> list[str]:
    """Return a text for each family and controller that survived less than a share."""
    return [
        f'{controller} in {family}: {survived}/{driven}'
        for (family, controller), (survived, driven) in counts(rows).items()
        if family != ALL and driven and survived / driven < share
    ]
