"""What was lost though it was possible, and controllers compared on the same draws.

Rows are those of `experiments library`, as `report.read_rows` returns them. A draw that any
controller survived is possible: its drive proves it. For the others `verdict` searches.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from scipy.stats import binomtest

from experiments import drive_row
from experiments.drive_row import Row
from experiments.library.survival_table import ALL, family_of
from experiments.statistical_inference import paired_interval
from experiments.survivable.survival_search import (
    IMPOSSIBLE,
    POSSIBLE,
    SEARCH_VERSION,
    UNDECIDED,
    survivable,
)
from scenario_publisher.families.draw import NOMINAL

# the first drives until the instant of action; all of them are drivers with hindsight
ANSWERS = (POSSIBLE, IMPOSSIBLE, UNDECIDED)
DRIVERS = ('mpcc', 'mpcc_road')

Rows = Sequence[Mapping[str, Any]]


class Regret(NamedTuple):
    """The draws of a family, by what is known of them, and who survived how many."""

    family: str
    answers: Mapping[str, int]  # of POSSIBLE, IMPOSSIBLE, UNDECIDED: draws
    survived: Mapping[str, int]  # of each controller: draws
    driven: Mapping[str, int]  # of each controller: draws of POSSIBLE, with a result
    driven_or_undecided: Mapping[str, int]


class Pairs(NamedTuple):
    """Two controllers on the same draws: on how many each survived."""

    base: str
    other: str
    both: int
    base_only: int
    other_only: int
    neither: int

    @property
    def draws(self) -> int:
        """The draws that both have driven."""
        return self.both + self.base_only + self.other_only + self.neither

    @property
    def difference(self) -> float:
        """The share that the base survived minus that of the other."""
        return (self.base_only - self.other_only) / self.draws

    @property
    def interval(self) -> tuple[float, float]:
        """Tango's score interval of 95 % of the difference."""
        return paired_interval(self.base_only, self.other_only, self.draws)

    @property
    def p_value(self) -> float:
        """McNemar's exact test: how likely so uneven a split is when neither is better."""
        differ = self.base_only + self.other_only
        return float(binomtest(self.base_only, differ).pvalue) if differ else 1.0


def draw_key(row: Mapping[str, Any]) -> Row:
    """Return what identifies the draw of a row, whoever drove it: a Row without controller."""
    return Row(
        row['scenario'],
        '',
        row['plant_settings'],
        row['seed'] or 0,
        row['difficulty'] or NOMINAL,
        row['offset'],
    )


def proved_by_drives(rows: Iterable[Mapping[str, Any]]) -> dict[Row, str]:
    """Return the draws that a controller survived, with the first one that did."""
    proved: dict[Row, str] = {}
    for row in rows:
        if row['survived'] is True:
            proved.setdefault(draw_key(row), row['controller'])
    return proved


def verdict_key(draw: Row, budget: int, preview: bool) -> str:
    """Return the SHA-256 of what decides a verdict: scenario, plant, budget, version of the search.

    The code of the controllers is no part of it: a drive that survived stays a proof.
    """
    setup = drive_row.prepare(draw._replace(controller=DRIVERS[0]), any_car=True)
    content = [SEARCH_VERSION, setup.scn.text, repr(setup.plant), setup.friction, budget, preview]
    return hashlib.sha256(json.dumps([*content, draw.offset]).encode()).hexdigest()


def verdict(draw: Row, budget: int, preview: bool) -> str:
    """Return {'answer': ..., 'how': ..., 'rollouts': ...} of a draw as JSON."""
    setups = [
        drive_row.prepare(draw._replace(controller=driver), any_car=True) for driver in DRIVERS
    ]
    drivers = [setup.params for setup in setups]
    result = survivable(setups[0], budget, preview=preview, drivers=drivers)
    return json.dumps({'answer': result.answer, 'how': result.how, 'rollouts': result.rollouts})


def count_regret(rows: Rows, answers: Mapping[Row, str]) -> list[Regret]:
    """Return the families of the rows in their order, then all of them if there are several.

    answers  by draw; a draw without one counts as undecided
    """
    families = list(dict.fromkeys(map(family_of, rows)))
    controllers = list(dict.fromkeys(row['controller'] for row in rows))
    judged = [
        (family_of(row), row['controller'], row['survived'] is True, draw_key(row))
        for row in rows
        if not row['error']
    ]
    counted = []
    for family in [*families, ALL] if len(families) > 1 else families:
        own = [drive for drive in judged if family in (ALL, drive[0])]
        by_draw = {draw: answers.get(draw, UNDECIDED) for *_, draw in own}
        of = {name: [drive for drive in own if drive[1] == name] for name in controllers}
        kinds = {name: [by_draw[draw] for *_, draw in drives] for name, drives in of.items()}
        counted.append(
            Regret(
                family,
                {kind: list(by_draw.values()).count(kind) for kind in ANSWERS},
                {name: sum(drive[2] for drive in drives) for name, drives in of.items()},
                {name: values.count(POSSIBLE) for name, values in kinds.items()},
                {name: len(values) - values.count(IMPOSSIBLE) for name, values in kinds.items()},
            )
        )
    return counted


def lost_though_possible(
    rows: Rows, answers: Mapping[Row, str], controller: str
) -> Iterator[tuple[Mapping[str, Any], str]]:
    """Yield the rows that a controller lost: POSSIBLE draws first, then UNDECIDED ones."""
    for kind in (POSSIBLE, UNDECIDED):
        for row in rows:
            lost = row['controller'] == controller and row['survived'] is not True
            if lost and answers.get(draw_key(row), UNDECIDED) == kind:
                yield row, kind


def pair(rows: Rows, base: str, other: str) -> Pairs:
    """Return how two controllers did on the draws that both have driven."""
    survived = {
        name: {
            draw_key(row): row['survived'] is True
            for row in rows
            if row['controller'] == name and not row['error']
        }
        for name in (base, other)
    }
    common = survived[base].keys() & survived[other].keys()
    split = [(survived[base][draw], survived[other][draw]) for draw in common]
    counts = (split.count(kind) for kind in ((True, True), (True, False), (False, True)))
    return Pairs(base, other, *counts, split.count((False, False)))
