"""The verdict on a claim: its share among the settings that satisfy a precondition level.

A setting is driven several times with tiny perturbations. It *holds* when the claim holds in most
of them, and is *undetermined* when the perturbations disagree on that, or one of them does not
tell: its drives failed, a car did not brake, or it left the preconditions. *Strictly*, it is also
undetermined when the paired difference spreads by more than the equivalence margin. What is
undetermined might go either way, so that a verdict needs both bounds of the share: the one that
counts undetermined settings as failures, and the one that counts them as successes.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd

from experiments import statistical_inference
from experiments.settings_analysis import setting_statistics
from experiments.settings_analysis.setting_statistics import Interval

REPRODUCED, IN_PART, NOT, OPEN = 'reproduced', 'in part', 'not reproduced', 'open'


class Rule(NamedTuple):
    """How a share of settings becomes a verdict; the study's file fixes the numbers."""

    holds_from: float  # reproduced: the whole interval of the share lies above
    rare_below: float  # not reproduced: the whole interval lies below
    confidence: float


class Outcomes(NamedTuple):
    """One claim at settings, arrays (n,) in equal order."""

    holds: np.ndarray  # bool, in most perturbations
    undetermined: np.ndarray  # bool
    difference: np.ndarray  # median over perturbations; NaN where there is none

    @property
    def settings(self) -> int:
        """The number of settings."""
        return len(self.holds)


class Decision(NamedTuple):
    """A claim at one precondition level, from one baseline."""

    settings: int
    holds: int
    share: float | None  # None without settings, as what follows
    interval: Interval | None  # of the share
    least: Interval | None  # of the share when what is undetermined does not hold
    most: Interval | None  # likewise when it does
    undetermined: float | None  # share
    p_value: float  # that the share is at none of the two ends of the rule, see `decide`
    median: float | None  # of the paired difference, where the claim has one
    median_interval: Interval | None
    relation: str | None  # of the difference to the equivalence margin


def summarise(pairs: pd.DataFrame, margin: float | None) -> pd.DataFrame:
    """Return the judgement of each setting on one claim.

    Its columns are `holds`, `difference`, `unknown`, `undetermined`, `undetermined_strictly`.

    `pairs` has a row per setting and perturbation with the columns `setting`, `holds` (1 or 0; NaN
    where the start does not tell) and `difference` (NaN where one of the cars has no such value).
    `margin` is the equivalence margin in the difference's unit, None for a claim without a
    difference. `unknown` says whether some start does not tell, which makes a setting
    undetermined; where none tells the claim has no meaning and the setting is left out.
    """
    grouped = pairs.groupby('setting', sort=True)
    share, known = grouped['holds'].mean(), grouped['holds'].count()
    unknown = known < grouped.size()
    undetermined = (share > 0.0) & (share < 1.0) | unknown
    strictly = undetermined
    if margin is not None:
        # a value that only some of the perturbations have is no agreement either
        numbers = grouped['difference'].count()
        spread = grouped['difference'].max() - grouped['difference'].min()
        strictly = strictly | (spread > margin) | (numbers > 0) & (numbers < grouped.size())
    by_setting = pd.DataFrame(
        {
            'holds': share > 0.5,
            'difference': grouped['difference'].median(),
            'unknown': unknown,
            'undetermined': undetermined,
            'undetermined_strictly': strictly,
        }
    )
    return by_setting[known > 0]


def outcomes(by_setting: pd.DataFrame, is_strict: bool = False) -> Outcomes:
    """Return the Outcomes of a table of `summarise`, by either meaning of undetermined."""
    return Outcomes(
        by_setting['holds'].to_numpy(bool),
        by_setting['undetermined_strictly' if is_strict else 'undetermined'].to_numpy(bool),
        by_setting['difference'].to_numpy(float),
    )


def decide(given: Outcomes, margin: float | None, rule: Rule) -> Decision:
    """Return the decision on a claim.

    Its p-value is twice the smaller one of two exact one-sided tests, each with the bound that
    favours the hypothesis: that the share of what surely holds is at most `holds_from`, and that
    the share of what may hold is at least `rare_below`.
    """
    n = given.settings
    if not n:
        return Decision(0, 0, None, None, None, None, None, 1.0, None, None, None)
    surely, possibly = given.holds & ~given.undetermined, given.holds | given.undetermined

    def interval(holds):
        return setting_statistics.share_interval(holds, rule.confidence)

    p_value = 2.0 * min(
        setting_statistics.share_p_value(int(surely.sum()), n, rule.holds_from, 'greater'),
        setting_statistics.share_p_value(int(possibly.sum()), n, rule.rare_below, 'less'),
    )
    median = median_interval = relation = None
    known = given.difference[np.isfinite(given.difference)]
    if margin is not None and len(known):
        median = float(np.median(known))
        median_interval = setting_statistics.median_interval(known, rule.confidence)
        relation = setting_statistics.relation(median_interval, margin)
    return Decision(
        settings=n,
        holds=int(given.holds.sum()),
        share=float(given.holds.mean()),
        interval=interval(given.holds),
        least=interval(surely),
        most=interval(possibly),
        undetermined=float(given.undetermined.mean()),
        p_value=min(1.0, p_value),
        median=median,
        median_interval=median_interval,
        relation=relation,
    )


def verdict(decision: Decision, p_adjusted: float, rule: Rule) -> str:
    """Return the verdict on a claim from its decision and its p-value after Holm's correction.

    reproduced      the share is above `holds_from`, whatever the undetermined settings are
    not reproduced  it is below `rare_below`, likewise
    in part         it is neither, whatever they are
    open            the settings do not tell
    """
    if not decision.settings:
        return OPEN
    sure = p_adjusted <= 1.0 - rule.confidence
    if sure and decision.least.low > rule.holds_from:
        return REPRODUCED
    if sure and decision.most.high < rule.rare_below:
        return NOT
    if decision.least.low > rule.rare_below and decision.most.high < rule.holds_from:
        return IN_PART
    return OPEN


def judge(decisions: Mapping[str, Decision], rule: Rule) -> dict[str, tuple[float, str]]:
    """Return {claim: (p-value after Holm's correction, verdict)} of a family of decisions."""
    adjusted = statistical_inference.holm({claim: d.p_value for claim, d in decisions.items()})
    return {
        claim: (adjusted[claim], verdict(decision, adjusted[claim], rule))
        for claim, decision in decisions.items()
    }
