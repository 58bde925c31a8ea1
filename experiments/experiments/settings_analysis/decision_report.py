"""The files of `experiments study decide`: tables, claims.json, figures, with their provenance."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import pandas as pd

from experiments.settings import arms
from experiments.settings.preconditions import ACCEPTED
from experiments.settings.preregistration import LEVELS
from experiments.settings_analysis import (
    decide,
    decision_figures,
    outcome_report,
    sensitivity,
    study_tables,
)
from experiments.settings_analysis.decide import Results
from experiments.settings_analysis.study_tables import Study
from experiments.study import tables
from node_runtime import provenance

CLAIMS, VERDICTS, CAUSES, DRIVERS = 'claims', 'verdicts', 'causes', 'drivers'
ACCEPTED_SETTINGS = 'accepted'
COMMAND = 'experiments study decide'


def run(folders: Sequence[Path], out: Path) -> list[Path]:
    """Decide the study of a folder, or of several as one, into `out`; return the paths.

    Raises BagError.
    """
    studies = [study_tables.load(folder) for folder in folders]
    study = studies[0] if len(studies) == 1 else study_tables.pool(studies)
    return write(study, decide.decide(study), out)


def write(study: Study, results: Results, out: Path) -> list[Path]:
    """Write tables, claims.json and figures into the folder `out`; return the paths."""
    paths = write_claims(study, results, out)
    paths += _write_table(
        out, VERDICTS, _verdict_rows(study, results), verdict_text(study, results)
    )
    paths += _write_table(out, CAUSES, _effect_rows(results), _cause_text(results))
    paths += _write_table(out, DRIVERS, _driver_rows(results), _driver_text(results))
    for baseline in study.baselines:
        path = out / f'{ACCEPTED_SETTINGS}_{baseline}.csv'
        sensitivity.marginals(study, baseline).to_csv(path, index=False, lineterminator='\n')
        paths.append(path)
    paths += decision_figures.write_shares(study, results, out / 'shares')
    is_mapped = decide.DRIVER_LEVEL in study.levels
    for baseline in study.baselines if is_mapped else ():
        paths += decision_figures.write_maps(study, baseline, out / f'map_{baseline}')
    paths += decision_figures.write_causes(results, out / 'causes')
    paths += decision_figures.write_drivers(study, results, out / 'drivers')
    return paths + outcome_report.write(study, out)


def write_claims(study: Study, results: Results, out: Path) -> list[Path]:
    """Write claims.json into the folder `out`, which it makes; return its path."""
    out.mkdir(parents=True, exist_ok=True)
    claims = decide.claim_entries(study, results)
    content = {'provenance': _origin(study), 'counts': results.counts, 'claims': claims}
    path = out / f'{CLAIMS}.json'
    path.write_text(tables.dump_json(content))
    return [path]


def _origin(study):
    return {
        'command': COMMAND,
        'run': study.run,
        'seed': study.seed,
        'seeds': study.seeds,
        'screened': study.is_screened,
        'departures': study.departures,
        'otherwise_driven': study.otherwise_driven,
        'failed_drives': study.failed,
        'censored_onsets': study_tables.censored_onsets(study),
        'settings': study.settings,
        'drives': len(study.drives),
        'preregistration_sha256': study.plan.digest,
        'study': _notes(study),
        'versions': provenance.versions(),
        'machine': provenance.machine(),
    }


def _notes(study):
    if study.parts:
        return {part.run: _notes(part) for part in study.parts}
    return {name: study.notes[name] for name in ('git_commit', 'points', 'rejected')}


def _write_table(out, stem, rows: Sequence[Mapping[str, Any]], text):
    paths = [out / f'{stem}.md', out / f'{stem}.csv']
    paths[0].write_text(text)
    pd.DataFrame(rows).to_csv(paths[1], index=False, lineterminator='\n')
    return paths


def _verdict_rows(study, results):
    return [
        {
            'claim': result.claim,
            'baseline': result.baseline,
            'from': result.least,
            'level': result.level,
            'primary': result.primary,
            'settings': result.decision.settings,
            'holds': result.decision.holds,
            'share': result.decision.share,
            **_ends('interval', result.decision.interval),
            **_ends('undetermined_fail', result.decision.least),
            **_ends('undetermined_hold', result.decision.most),
            'undetermined': result.decision.undetermined,
            'undetermined_by_unknown_starts': result.unknown,
            'undetermined_strictly': result.strict.undetermined,
            'p_adjusted': result.p_adjusted,
            'median_difference': result.decision.median,
            **_ends('median', result.decision.median_interval),
            'margin': study_tables.margin(study.plan, result.claim),
            'relation': result.decision.relation,
            'verdict': result.verdict,
            'verdict_strictly': result.strict_verdict,
        }
        for result in results.judged
    ]


def _ends(name, interval):
    low, high = (None, None) if interval is None else interval
    return {f'{name}_low': low, f'{name}_high': high}


def verdict_text(study: Study, results: Results) -> str:
    """Return verdicts.md."""
    rule = decide.rule_of(study.plan)
    lines = [
        '# The claims over many settings',
        '',
        f'{study.settings:,} settings, {len(study.drives):,} drives, {_seeds(study)}. '
        f'A claim is *reproduced* where the whole interval of its share lies above '
        f'{rule.holds_from:g}, *not reproduced* where it lies below {rule.rare_below:g}, *in part* '
        'where it lies between, each whatever the undetermined settings are, else it is *open*. '
        'Intervals: 95 %, bootstrap over settings; p-values after Holm over the claims of a '
        'version of the baseline.',
        '',
        *_departures(study),
        'Settings that reach each level:',
        '',
        _counts(results),
        *_screened(study),
        *_censored(study),
        *_too_few(study, results),
    ]
    for baseline in study.baselines:
        own = [result for result in results.judged if result.baseline == baseline]
        lines += [
            *(f'## {baseline}, {_role(study, baseline)}', ''),
            *('Each claim at its own level:', ''),
            _verdict_table([result for result in own if result.primary]),
            *('Each claim by stratum of S, as settings in which it holds of all:', ''),
            _strata_table(study, [result for result in own if result.primary]),
            *('The same at the other levels:', ''),
            _verdict_table([result for result in own if not result.primary]),
            *('Which of the two cars brakes hard before obstacle 2, any S:', ''),
            _braking_table(study, baseline),
            *('Each claim where the outlines of both cars, too, touch nothing; undisturbed:', ''),
            _outline_table(study, baseline),
        ]
    lines += ['## How drives end', '', 'Undisturbed, by circles, of all that were driven:', '']
    lines.append(_ends_table(study))
    return '\n'.join(lines)


def _role(study, baseline):
    is_confirmatory = study.is_confirmatory and baseline == study.plan.decision.confirmatory
    return 'confirmatory' if is_confirmatory else 'exploratory'


def _braking_table(study, baseline):
    levels = [level for level in study.levels if level < 'P4']
    counts = {level: study_tables.braking(study, baseline, level) for level in levels}
    header = ['level', *next(iter(counts.values()))]
    rows = [[level, *map(_count, row.values())] for level, row in counts.items()]
    return tables.markdown_table(header, rows)


def _outline_table(study, baseline):
    rows = [
        [result.claim, result.level, f'{result.holds} of {result.settings}']
        for result in sensitivity.by_outline(study, baseline)
    ]
    return tables.markdown_table(['claim', 'level', 'holds'], rows)


def _ends_table(study):
    driven = (arms.NO_CA, arms.MPCC, *study.baselines)
    rows = [[arm, *map(_count, sensitivity.ends(study, arm).values())] for arm in driven]
    return tables.markdown_table(['controller', *sensitivity.ENDS], rows)


def _strata_table(study, judged):
    ends = study.plan.strata.S
    header = ['claim', *(f'{low:g} to {high:g}' for low, high in pairwise(ends))]
    rows = [
        [result.claim, *(f'{held} of {count}' for held, count in decide.by_stratum(study, result))]
        for result in judged
    ]
    return tables.markdown_table(header, rows)


def _seeds(study):
    if not study.parts:
        return f'seed {study.seed}'
    runs = ' and '.join(f'{part.run} (seed {part.seed})' for part in study.parts)
    return f'the runs {runs} pooled, which was not preregistered'


def _departures(study):
    if not study.departures:
        return []
    return [f'**Not the preregistered run**: {"; ".join(study.departures)}.', '']


def _censored(study):
    few, count = study_tables.censored_onsets(study)
    after_s = study.plan.primaries.brake_onset.censored_s
    text = f'{few:,} of {count:,} onsets of braking lie in the first {after_s:g} s of the drive.'
    return ['', text, '']


def _screened(study):
    if not study.is_screened:
        return []
    text = 'The study is screened: it tells nothing of P1 and P2, has no drivers and no maps.'
    return ['', text, '']


def _too_few(study, results):
    """Return the lines that say where fewer settings were accepted than the rule asks for."""
    decision = study.plan.decision
    few = [
        f'{row[ACCEPTED]:,} for {row["baseline"]}'
        for row in results.counts
        if row['least'] == decision.from_level and row[ACCEPTED] < decision.least_settings
    ]
    if not few:
        return []
    asked = f'{decision.least_settings:,} at {decision.from_level} to {ACCEPTED}'
    return ['', f'Fewer settings than asked for, {asked}: {", ".join(few)}.', '']


def _counts(results):
    names = {LEVELS[0]: 'with P0', decide.ANY_S: 'any S'}
    header = ['baseline', '', 'settings', *LEVELS]
    rows = [
        [row['baseline'], names[row['least']], *(_count(row[key]) for key in ('settings', *LEVELS))]
        for row in results.counts
    ]
    return tables.markdown_table(header, rows)


def _count(value):
    return '–' if value is None else f'{value:,}'


def _verdict_table(judged):
    header = ['claim', 'level', 'holds', 'share', 'undetermined', 'difference', 'verdict']
    header += ['undetermined, strictly', 'verdict, strictly']
    return tables.markdown_table(header, [_verdict_row(result) for result in judged])


def _verdict_row(result):
    decision, difference = result.decision, '–'
    if decision.median is not None:
        size = (
            f'{decision.median:.2f} {_span(decision.median_interval)} {decide.UNITS[result.claim]}'
        )
        difference = f'{size}: {decision.relation}'
    return [
        result.claim,
        f'{result.level} and P0' if result.least == LEVELS[0] else result.level,
        f'{decision.holds} of {decision.settings}',
        '–' if decision.share is None else f'{decision.share:.2f} {_span(decision.interval)}',
        '–' if decision.undetermined is None else f'{decision.undetermined:.0%}',
        difference,
        result.verdict,
        '–' if decision.undetermined is None else f'{result.strict.undetermined:.0%}',
        result.strict_verdict,
    ]


def _span(interval):
    if not math.isfinite(interval.low):  # of a single setting
        return '[–]'
    return f'[{interval.low:.2f}, {interval.high:.2f}]'


def _effect_rows(results):
    return [
        {
            'claim': claim,
            'response': decide.RESPONSES[claim],
            'term': effect.term,
            'order': effect.order,
            'settings': effect.settings,
            'effect': effect.mean,
            **_ends('interval', effect.interval),
            'p_value': effect.p_value,
            'p_adjusted': effect.p_adjusted,
        }
        for claim, effects in results.effects.items()
        for effect in effects
    ]


def _cause_text(results):
    lines = [
        '# What makes the difference between baseline and MPCC',
        '',
        'A full factorial at matched settings: every combination of five factors, each as the MPCC '
        'has it or as the baseline has it. The effect is the mean response with the factor as in '
        'the baseline less that as in the MPCC; for an interaction, where the product of the codes '
        'is +1 less where it is -1. Intervals: bootstrap over settings; p-values after Holm over '
        'the 31 terms. Only settings count that all 32 combinations complete. Main effects, and '
        'interactions beyond chance. *Left over* is what of `frenet_matched` the combination with '
        'its factors does not give, the median over settings: where it may exceed the margin, the '
        'factors do not explain the difference.',
        '',
    ]
    for claim, effects in results.effects.items():
        shown = [e for e in effects if e.order == 1 or e.p_adjusted <= decide.SIGNIFICANT]
        lines += [f'## {claim}: {decide.RESPONSES[claim]}', '']
        rows = [
            [e.term, f'{e.mean:+.3f} {_span(e.interval)}', f'{e.p_adjusted:.3f}', str(e.settings)]
            for e in shown
        ]
        unit = decide.UNITS.get(claim, '-')
        lines.append(tables.markdown_table(['term', f'effect [{unit}]', 'p', 'settings'], rows))
        if left := results.residuals.get(claim):
            span = f'{left.median:+.3f} {_span(left.interval)} {unit}'
            lines += [f'Left over: {span} over {left.settings} settings.', '']
    if not results.effects:
        lines.append('No setting was driven by the combinations of the factorial.\n')
    return '\n'.join(lines)


def _driver_rows(results):
    return [
        {'baseline': baseline, 'claim': claim, 'model': surrogate.model, 'score': surrogate.score}
        | driver._asdict()
        for (baseline, claim), surrogate in results.drivers.items()
        for driver in surrogate.drivers
    ]


def _driver_text(results):
    lines = [
        '# Which dimensions drive the differences',
        '',
        'A regression over the drawn dimensions, fitted to the median paired difference of each '
        'setting in which neither car crashes. Where it does not predict settings that it has not '
        'seen, there is none. Indices belong to the regression over independent inputs; the '
        'permutation importance is measured on held-out settings.',
        '',
    ]
    for (baseline, claim), surrogate in results.drivers.items():
        score = (
            '–'
            if surrogate.score is None
            else f'{surrogate.score:.2f} ± {surrogate.score_spread:.2f}'
        )
        lines += [f'## {claim}, {baseline}', '']
        text = f'{surrogate.settings} settings, {surrogate.model}, cross-validated R² {score}'
        if not surrogate.is_usable:
            lines += [f'{text}: no surrogate.', '']
            continue
        rows = [_driver_row(driver) for driver in surrogate.drivers[:8]]
        header = ['dimension', 'first order', 'total', 'permutation']
        lines += [f'{text}.', '', tables.markdown_table(header, rows)]
    return '\n'.join(lines)


def _driver_row(driver) -> Iterable[str]:
    return [
        driver.dimension,
        f'{driver.first:.2f} ± {driver.first_interval:.2f}',
        f'{driver.total:.2f} ± {driver.total_interval:.2f}',
        f'{driver.permutation:.2f}',
    ]
