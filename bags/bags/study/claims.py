"""Every claim of the paper with the paper's number, ours, a verdict with its interval, a cause."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from bags.study import (
    causes,
    curvature,
    distributions,
    provenance,
    samples,
    statistics,
    tables,
    variants,
)
from bags.study.claim_list import CLAIMS, CONVERGENCE
from bags.study.claim_rules import Claim, Runs, verdict
from bags.study.distributions import POINT_KPH, RUNS, SPEEDS_KPH
from bags.study.drives import Drives, Record
from bags.study.quantities import BY_NAME
from bags.study.variants import SCENARIO

STEM = 'claims'


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
) -> Claims:
    """Judge every claim over paired runs; write claims.md, .csv and claims.json (a list).

    The first of `speeds_kph` is the operating point, the others say how far it carries;
    `cause_runs` of the draws, by default all, look for causes. Raises BagError.
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
        'bags study claims', scenario, seed, runs=runs, roles=dict(roles), speeds_kph=speeds_kph
    )
    text = told(made)
    paths = tables.write(out, STEM, 'The claims of the paper', made, text, where)
    # the form in which others read it: a list
    (out / f'{STEM}.json').write_text(tables.dumped(made))
    (out / f'{STEM}_provenance.json').write_text(tables.dumped(where))
    return Claims(made, text, [*paths, out / f'{STEM}_provenance.json'])


def paired(records: Mapping[str, Sequence[Record]]) -> list[Runs]:
    """Return the drives of every draw by role."""
    return [dict(zip(records, runs)) for runs in zip(*records.values())]


def _row(claim: Claim, cast: Sequence[Runs], rows, elsewhere: Mapping[float, Sequence[Runs]]):
    strict = statistics.share([claim.strict(runs) for runs in cast])
    loose = statistics.share([claim.loose(runs) for runs in cast])
    cause, data = causes.of(claim, cast, rows)
    return {
        'key': claim.key,
        'claim': claim.claim,
        'paper': claim.paper,
        'ours': '; '.join(_shown(one, cast) for one in claim.shown),
        'operating_point': f'{POINT_KPH:g} km/h, {len(cast)} paired runs',
        'verdict': verdict(strict, loose),
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
    return _row(CONVERGENCE, pairs, rows, {})


def _curvature():
    found = curvature.row()
    data = found.pop('data')
    empty = {'rule': 'closed form', 'holds': None, 'runs': None, 'low': None, 'high': None}
    return {
        **{name: found[name] for name in ('key', 'claim', 'paper', 'ours')},
        'operating_point': 'circle, no drive',
        'verdict': found['verdict'],
        'interval': found['interval'],
        'strict': empty,
        'loose': empty,
        'elsewhere': {},
        'cause': found['cause'],
        'cause_data': [data],
    }


def _shown(one, cast):
    quantity = BY_NAME[one.quantity]
    over = statistics.summary([runs[one.role].value(one.quantity) for runs in cast])
    if not over.runs:
        return f'{one.role}: no {quantity.title}'
    median, least, most = map(quantity.told, (over.median, over.least, over.most))
    unit = '' if quantity.unit == '-' else f' {quantity.unit}'
    some = f' in {over.runs} of {len(cast)}' if over.runs < len(cast) else ''
    return f'{one.role} {quantity.title} {median} [{least}, {most}]{unit}{some}'


def _share(found):
    return {'holds': found.holds, 'runs': found.runs, 'low': found.low, 'high': found.high}


def _interval(found):
    return f'{found.holds}/{found.runs} [{found.low:.2f}, {found.high:.2f}]'


def told(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the claims as a Markdown table."""
    header = ['claim', 'paper', 'ours: median [least, most]', 'verdict', 'holds', 'cause']
    lines = [
        [row[name] for name in ('claim', 'paper', 'ours', 'verdict', 'interval', 'cause')]
        for row in rows
    ]
    return tables.markdown(header, lines)
