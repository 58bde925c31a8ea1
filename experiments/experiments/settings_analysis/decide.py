"""`experiments study decide`: the verdicts of a study over many settings, and what drives them."""

import math
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from experiments.settings import arms
from experiments.settings.preregistration import LEVELS, Preregistration
from experiments.settings.primaries import CLAIMS
from experiments.settings_analysis import (
    factorial,
    setting_statistics,
    study_tables,
    surrogate,
    verdicts,
)
from experiments.settings_analysis.factorial import Effect
from experiments.settings_analysis.setting_statistics import Interval
from experiments.settings_analysis.study_tables import Study
from experiments.settings_analysis.surrogate import Surrogate
from experiments.settings_analysis.verdicts import Decision, Rule

# what the paper says, and its number
PAPER = {
    'unsafe_area': ('the baseline enters an unsafe area, the MPCC does not', 'baseline only'),
    'sideslip': ('the baseline slides, the MPCC does not', '9 deg against 3 deg'),
    'brake_onset': ('the MPCC brakes earlier than the baseline', '20 m earlier'),
    'min_speed': ('the MPCC keeps the higher speed', 'higher'),
    'conjunction': ('all of these in one manoeuvre', 'one figure'),
}
# of the differences
UNITS = {'unsafe_area': 'm', 'sideslip': 'deg', 'brake_onset': 'm', 'min_speed': 'm/s'}
RESPONSES = {
    'unsafe_area': 'kept_m',
    'sideslip': 'peak_sideslip_deg',
    'brake_onset': 'brake_onset_m',
    'min_speed': 'min_speed_mps',
}
# the search for the tuned baseline saw the quantity of the first of these claims
NOT_TUNED = ('unsafe_area', 'conjunction')
ANY_S = 'P1'  # the first condition that is no bound of S
DRIVER_LEVEL = 'P2'  # settings from which the surrogate learns: whoever does not crash
SHOWN_DRIVERS = 3
SIGNIFICANT = 0.05


class Judged(NamedTuple):
    """A claim at one level, from one version of the baseline."""

    claim: str
    baseline: str
    level: str
    least: str  # the first of the conditions that count
    primary: bool  # whether this is the preregistered level of the claim
    decision: Decision
    p_adjusted: float
    verdict: str
    strict: Decision  # where a spread above the margin leaves a setting undetermined, too
    strict_verdict: str
    table: pd.DataFrame  # by setting, see `verdicts.summarise`

    @property
    def unknown(self) -> float | None:
        """The share of settings with a start that does not tell, None without settings."""
        return float(self.table['unknown'].mean()) if len(self.table) else None

    def __repr__(self) -> str:
        return f'Judged({self.claim!r}, {self.baseline!r}, {self.level!r}, {self.verdict!r})'


class Residual(NamedTuple):
    """What of a difference between baseline and MPCC the factors do not give."""

    settings: int
    median: float
    interval: Interval

    def exceeds(self, margin: float) -> bool:
        """Return whether it is not within the equivalence margin for sure."""
        return self.interval.low < -margin or self.interval.high > margin


class Results(NamedTuple):
    """All that a study decides."""

    counts: list[dict[str, Any]]  # settings at each level by baseline
    judged: list[Judged]
    effects: dict[str, list[Effect]]  # by key of RESPONSES
    drivers: dict[tuple[str, str], Surrogate]  # by baseline and claim
    residuals: dict[str, 'Residual']  # of the factorial, by key of RESPONSES

    def __repr__(self) -> str:
        return f'Results({len(self.judged)} judged claims)'


def decide(study: Study, explained: Collection[str] = tuple(UNITS)) -> Results:
    """Return the results of a study; nothing here is random but seeded resampling.

    `explained` are the claims whose drivers are computed, which takes seconds each.
    """
    judged = [result for baseline in study.baselines for result in _judge(study, baseline)]
    return Results(
        counts=level_counts(study),
        judged=judged,
        effects=_effects(study),
        drivers=_drivers(study, explained),
        residuals=_residuals(study),
    )


def rule_of(plan: Preregistration) -> Rule:
    """Return the rule of the verdicts."""
    given = plan.decision
    return Rule(given.holds_from, given.rare_below, given.confidence)


def level_counts(study: Study) -> list[dict[str, Any]]:
    """Return the number of settings that reach each level, with and without P0.

    None below P3 for a screened study, in which not all settings were driven that far.
    """
    alone = study.outcomes[study.outcomes['baseline'] == '']
    rows = []
    for baseline in study.baselines:
        own = study.outcomes[study.outcomes['baseline'] == baseline]
        own = pd.concat([own.drop_duplicates('setting'), alone])
        for least in (LEVELS[0], ANY_S):
            silent = ('P1', 'P2') if study.is_screened else ()
            levels = [name for name in LEVELS[LEVELS.index(least) :] if name not in silent]
            reached = {
                level: int(study_tables.reaching(own, level, least)['setting'].nunique())
                for level in levels
            }
            rows.append(
                {
                    'baseline': baseline,
                    'least': least,
                    'settings': study.settings,
                    **{level: reached.get(level) for level in LEVELS},
                }
            )
    return rows


def _judge(study, baseline):
    """Yield every claim at every level of the study; the correction is that of `_family`."""
    own = study.outcomes[study.outcomes['baseline'] == baseline]
    plan, rule = study.plan, rule_of(study.plan)
    for least in (LEVELS[0], ANY_S):
        tables, decisions, strict = {}, {}, {}
        for level in study.levels:
            reached = study_tables.reaching(own, level, least)
            for claim in CLAIMS:
                if baseline == arms.TUNED and claim in NOT_TUNED:
                    continue
                if claim == 'conjunction' and level != study_tables.level(plan, claim):
                    continue  # with cars that do not brake it mixes two questions
                margin = study_tables.margin(plan, claim)
                table = verdicts.summarise(study_tables.pairs(reached, claim, level), margin)
                tables[claim, level] = table
                for results, is_strict in ((decisions, False), (strict, True)):
                    given = verdicts.outcomes(table, is_strict)
                    results[claim, level] = verdicts.decide(given, margin, rule)
        for (claim, level), decision in decisions.items():
            family = _family(plan, decisions, claim, level)
            p_adjusted, verdict = verdicts.judge(family, rule)[claim]
            strictly = verdicts.judge(_family(plan, strict, claim, level), rule)[claim]
            yield Judged(
                claim,
                baseline,
                level,
                least,
                primary=least == plan.decision.from_level
                and level == study_tables.level(plan, claim),
                decision=decision,
                p_adjusted=p_adjusted,
                verdict=verdict,
                strict=strict[claim, level],
                strict_verdict=strictly[1],
                table=tables[claim, level],
            )


def _family(plan, decisions, claim, level):
    """Return the decisions on a claim at a level, and on the others at their own levels."""
    levels = {other: study_tables.level(plan, other) for other in CLAIMS} | {claim: level}
    return {other: decisions[other, at] for other, at in levels.items() if (other, at) in decisions}


def _effects(study):
    drives = study_tables.factorial_drives(study)
    if drives.empty:
        return {}
    return {
        claim: factorial.analyse(drives, study_tables.FACTORS, response)
        for claim, response in RESPONSES.items()
    }


def _residuals(study):
    residuals = study_tables.beyond_the_factors(study)
    return {
        claim: Residual(
            len(residuals),
            float(residuals[response].median()),
            setting_statistics.median_interval(residuals[response].to_numpy()),
        )
        for claim, response in RESPONSES.items()
        if len(residuals)
    }


def _drivers(study, claims):
    if DRIVER_LEVEL not in study.levels:
        return {}
    features = surrogate.unit_features(study_tables.dimensions(study), list(study.plan.dimensions))
    surrogates = {}
    for baseline in study.baselines:
        own = study.outcomes[study.outcomes['baseline'] == baseline]
        own = study_tables.reaching(own, DRIVER_LEVEL, ANY_S)
        for claim in claims:
            pairs = study_tables.pairs(own, claim, DRIVER_LEVEL)
            difference = pairs.groupby('setting')['difference'].median().rename(claim)
            surrogates[baseline, claim] = surrogate.fit(features, difference)
    return surrogates


def by_stratum(study: Study, result: Judged) -> list[tuple[int, int]]:
    """Return in how many settings of each stratum of S a claim holds, and of how many."""
    held = result.table['holds'].groupby(study_tables.strata(study), observed=False)
    return [
        (int(row['sum']), int(row['count'])) for _, row in held.agg(['sum', 'count']).iterrows()
    ]


def counterexample(result: Judged) -> int | None:
    """Return the setting that contradicts the verdict most clearly, None where none does.

    Of a claim that holds in most settings, that of the smallest difference among those in which it
    fails; otherwise that of the largest among those in which it holds. Only settings whose
    perturbations agree count.
    """
    table = result.table[~result.table['undetermined']]
    wanted = result.decision.share is not None and result.decision.share <= 0.5
    table = table[table['holds'] == wanted]
    if table.empty:
        return None
    if table['difference'].isna().all():
        return int(table.index[0])
    return int(table['difference'].idxmax() if wanted else table['difference'].idxmin())


def driver_names(fitted: Surrogate | None) -> list[str]:
    """Return the dimensions of the largest total indices that are above their uncertainty."""
    if fitted is None:
        return []
    certain = [driver for driver in fitted.drivers if driver.total > driver.total_interval]
    return [driver.dimension for driver in certain[:SHOWN_DRIVERS]]


def cause_names(effects: list[Effect]) -> list[str]:
    """Return the terms of the factorial that differ from zero after the correction."""
    return [effect.term for effect in effects if effect.p_adjusted <= SIGNIFICANT]


def causes(study: Study, results: Results, result: Judged) -> list[str] | None:
    """Return the causes of a claim's difference; None where the factorial does not explain it.

    It leads to `frenet_matched` alone, and explains nothing where what it leaves over may exceed
    the margin.
    """
    residual = results.residuals.get(result.claim)
    margin = study_tables.margin(study.plan, result.claim)
    if result.baseline != arms.MATCHED or residual is None or residual.exceeds(margin):
        return None
    return cause_names(results.effects.get(result.claim, []))


def claim_entries(study: Study, results: Results) -> list[dict[str, Any]]:
    """Return the entries of claims.json: one per claim and version of the baseline."""
    entries = []
    for result in results.judged:
        if not result.primary:
            continue
        text, number = PAPER[result.claim]
        example = counterexample(result)
        entries.append(
            {
                'claim': text,
                'key': result.claim,
                'paper': number,
                'baseline': result.baseline,
                'confirmatory': study.is_confirmatory
                and result.baseline == study.plan.decision.confirmatory,
                'level': f'{result.least} to {result.level}',
                'settings': result.decision.settings,
                'holds': result.decision.holds,
                'share': result.decision.share,
                'interval': result.decision.interval,
                'interval_undetermined_fail': result.decision.least,
                'interval_undetermined_hold': result.decision.most,
                'undetermined': result.decision.undetermined,
                'undetermined_by_unknown_starts': result.unknown,
                'undetermined_strictly': result.strict.undetermined,
                'p_adjusted': result.p_adjusted,
                'margin': study_tables.margin(study.plan, result.claim),
                'unit': UNITS.get(result.claim),
                'median_difference': result.decision.median,
                'median_interval': result.decision.median_interval,
                'relation': result.decision.relation,
                'verdict': result.verdict,
                'verdict_strictly': result.strict_verdict,
                'holds_by_stratum_of_S': by_stratum(study, result),
                'causes': causes(study, results, result),
                'drivers': driver_names(results.drivers.get((result.baseline, result.claim))),
                'counterexample': None
                if example is None or result.baseline == arms.TUNED  # needs its table, too
                else {
                    'setting': study_tables.origin(study, example)[1],
                    'command': command_of(study, example),
                },
            }
        )
    return [_finite(entry) for entry in entries]


def command_of(study: Study, number: int) -> str:
    """Return the command that drives one setting of a study."""
    seed, own_number = study_tables.origin(study, number)
    return f'experiments study setting --number {own_number} --seed {seed}'


def _finite(entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return an entry with None for numbers that are not finite: JSON has none of them."""

    def clean(value):
        if isinstance(value, dict):
            return {name: clean(inner) for name, inner in value.items()}
        if isinstance(value, (list, tuple)):
            return [clean(inner) for inner in value]
        if isinstance(value, (float, np.floating)):
            return float(value) if math.isfinite(value) else None
        return value

    return {name: clean(value) for name, value in entry.items()}
