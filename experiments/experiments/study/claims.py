"""Every claim of the paper with the paper's number, ours, a verdict with its interval, a cause."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from experiments.study import (
    causes,
    curvature,
    distributions,
    ours,
    provenance,
    samples,
    statistics,
    tables,
    variants,
)
from experiments.study.claim_list import CLAIMS, CONVERGENCE
from experiments.study.claim_rules import Claim, Runs, reasons, verdict, verdict_of
from experiments.study.distributions import POINT_KPH, RUNS, SPEEDS_KPH
from experiments.study.drives import Drives, Record
from experiments.study.variants import SCENARIO

STEM = 'claims'
COMMAND = 'experiments study claims'


class Claims(NamedTuple):
    """The table."""

    rows: list[dict[str, Any]]
    markdown: str  # the table as README shows it
    files: list[Path]


def run(
    drives: Drives,
    out: Path,
    runs: int = RUNS,
    cause_runs: int | None = None,
    speeds_kph: Sequence[float] = SPEEDS_KPH,
    roles: Mapping[str, str] = variants.ROLES,
    scenario: str = SCENARIO,
    seed: int = samples.SEED,
    command: str = COMMAND,
) -> Claims:
    """Judge every claim over paired runs; write claims.md, .csv and claims.json (a list).

    The first of `speeds_kph` is the operating point, the others say how far it carries;
    `cause_runs` of the draws, by default all, look for causes; `command` is what the files
    name as the one that made them. Raises BagError.
    """
    playing = variants.cast(roles)
    draws = samples.draws(runs, seed)
    found = {
        kph: paired(distributions.at_speed(drives, playing, kph, draws, scenario))
        for kph in speeds_kph
    }
    rows = distributions.at_speed(
        drives,
        variants.ablation(roles, scenario),
        POINT_KPH,
        samples.draws(cause_runs or runs, seed),
        scenario,
    )
    point, *others = speeds_kph
    made = [
        _row(claim, found[point], rows, {kph: found[kph] for kph in others}) for claim in CLAIMS
    ]
    made += [_convergence(rows), _curvature()]
    where = provenance.of(
        command,
        scenario,
        seed,
        {one.name: one.controller for one in playing},
        runs=runs,
        cause_runs=cause_runs or runs,
        speeds_kph=list(speeds_kph),
    )
    text = told(made)
    below = f'{text}\n{_legend(cause_runs or runs)}\n{undecided(made)}'
    paths = tables.write(out, STEM, 'The claims of the paper', made, below, where)
    # the form in which others read it: a list, in which each row says its reasons itself
    listed = [row | {'reasons': reasons([row['verdict']])} for row in made]
    (out / f'{STEM}.json').write_text(tables.dumped(listed))
    (out / f'{STEM}_provenance.json').write_text(tables.dumped(where))
    return Claims(listed, text, [*paths, out / f'{STEM}_provenance.json'])


def paired(records: Mapping[str, Sequence[Record]]) -> list[Runs]:
    """Return the drives of every draw by role."""
    return [dict(zip(records, runs)) for runs in zip(*records.values())]


def _row(
    claim: Claim,
    cast: Sequence[Runs],
    rows: causes.Rows,
    elsewhere: Mapping[float, Sequence[Runs]],
    names: Mapping[str, str] = variants.ROLES,
) -> dict[str, Any]:
    strict = statistics.share([claim.strict(runs) for runs in cast])
    loose = statistics.share([claim.loose(runs) for runs in cast])
    outcome = verdict(strict, loose)
    cause, data = causes.of(claim, cast, rows, outcome)
    return {
        'key': claim.key,
        'claim': claim.claim,
        'paper': claim.paper,
        'ours': ours.told(claim.shown, cast, names),
        'operating_point': f'{POINT_KPH:g} km/h, {len(cast)} paired runs',
        'verdict': verdict_of(claim.undecided, outcome),
        'rule_outcome': outcome,
        'interval': _interval(strict),
        'strict': {'rule': claim.strict_says, **_share(strict)},
        'loose': {'rule': claim.loose_says, **_share(loose)},
        'elsewhere': {
            f'{kph:g} km/h': _interval(statistics.share([claim.strict(runs) for runs in others]))
            for kph, others in elsewhere.items()
        },
        'cause': cause,
        'cause_data': data,
    }


def _convergence(rows):
    """The claim on the priority, on the MPCC's own states, everything else equal."""
    pairs = [
        {'mpcc': gaussian, 'frenet': step}
        for gaussian, step in zip(rows[variants.BASE], rows['cartesian lag step'])
    ]
    return _row(CONVERGENCE, pairs, rows, {}, {'mpcc': 'Gaussian', 'frenet': 'step'})


def _curvature():
    found = curvature.row()
    data = found.pop('data')
    empty = {'rule': 'closed form', 'holds': None, 'runs': None, 'low': None, 'high': None}
    return {
        **{name: found[name] for name in ('key', 'claim', 'paper', 'ours')},
        'operating_point': 'circle, no drive',
        'verdict': found['verdict'],
        'rule_outcome': found['verdict'],
        'interval': found['interval'],
        'strict': empty,
        'loose': empty,
        'elsewhere': {},
        'cause': found['cause'],
        'cause_data': [data],
    }


def _share(found):
    return {'holds': found.holds, 'runs': found.runs, 'low': found.low, 'high': found.high}


def _interval(found):
    return f'{found.holds}/{found.runs} [{found.low:.2f}, {found.high:.2f}]'


def told(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the claims as a Markdown table."""
    header = [
        *('claim', 'paper', 'ours: median [least, most]', 'verdict'),
        *('holds in runs [95 %]', 'at other speeds', 'cause'),
    ]
    lines = [
        [
            *(row[name] for name in ('claim', 'paper', 'ours', 'verdict', 'interval')),
            '; '.join(f'{at}: {share}' for at, share in row['elsewhere'].items()) or '–',
            row['cause'],
        ]
        for row in rows
    ]
    return tables.markdown(header, lines)


def undecided(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return why the claims marked so are not decided, as a Markdown list."""
    found = reasons(row['verdict'] for row in rows)
    if not found:
        return ''
    lines = ''.join(f'- ({key}) {reason}\n' for key, reason in found.items())
    return f'Not decided at this operating point, because\n\n{lines}'


def _legend(cause_runs):
    return (
        'Rules and margins are in docs/study.md. A cause is a single switch that turns the loose '
        f'rule, (a/b) in a of b runs; at most {cause_runs} paired runs were driven for it. Where a '
        'claim does not hold, "direction only" names what would bring about its loose rule.\n'
    )
