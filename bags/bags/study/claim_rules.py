"""The claims of the paper and when each counts as reproduced: all of it as data, in one place.

Every rule looks at one draw, driven by all controllers. `strict` is the claim with the paper's
size or place, within the margins stated; `loose` is its direction alone. From the shares of the
draws in which they hold, with their Wilson intervals, comes the verdict (see `verdict`).
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from bags.study.drives import Record
from bags.study.statistics import Share

Runs = Mapping[str, Record]  # of one draw, by role: mpcc, mpcc_no_ca, frenet
Rule = Callable[[Runs], bool]

REPRODUCED, PARTLY, NOT = 'reproduced', 'partly', 'not'  # the verdicts
REPRODUCED_FROM = 0.75  # the whole interval of the strict rule lies above
NOT_BELOW = 0.5  # the whole interval of the loose rule lies below
KEPT = 0.95  # of a safety distance
D_SFT = 0.5  # m, to obstacles and edges, of mpcc.yaml; a test compares
OVERSHOOTS_M = (125.0, 135.0)
NEAR_M = 5.0
EARLIER_M = 10.0  # half of the paper's 20 m
SLIDES_DEG = 6.0  # baseline, two thirds of the paper's 9 deg
STABLE_DEG = 4.0  # MPCC, the paper's 3 deg and a third
NOTICEABLE_MPS = 0.5  # of minimum speed; the paper gives no number
AT_LIMIT = 0.9  # of the friction of the road
PERIOD_MS = 50.0
PAPER_MEAN_MS, PAPER_MAX_MS = 15.6, 18.6


class Shown(NamedTuple):
    """A number that is printed as ours: quantity of a role."""

    role: str
    quantity: str


class Claim(NamedTuple):
    """One row of the table."""

    key: str
    claim: str
    paper: str
    strict: Rule
    strict_says: str
    loose: Rule
    loose_says: str
    shown: tuple[Shown, ...]
    # the role that single switches may take, so that the ablation can look for the cause
    switched: str | None = None
    # where nothing is left to switch
    reason: str = ''


def verdict(strict: Share, loose: Share) -> str:
    """Return REPRODUCED, PARTLY or NOT."""
    if strict.low >= REPRODUCED_FROM:
        return REPRODUCED
    return NOT if loose.high < NOT_BELOW else PARTLY
