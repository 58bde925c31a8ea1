"""What was lost though it was possible, and controllers compared on the same draws.

Rows are those of `experiments library`, as `report.read_rows` returns them. A draw that any
controller survived is possible: its drive proves it. For the others `verdict` searches.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from scipy.stats import binomtest

from experiments.library import library_drive
from experiments.library.library_drive import ENTRIES, LibraryDrive, Settings
from experiments.statistical_inference import paired_interval
from experiments.survivable.survival_search import (
    IMPOSSIBLE,
    POSSIBLE,
    SEARCH_VERSION,
    UNDECIDED,
    survivable,
)

# the first drives until the instant of action; all of them are drivers with hindsight
DRIVERS = ('mpcc', 'mpcc_road')
ALL = 'all'

Row = Mapping[str, Any]
# family, name of an entry, seed, index, difficulty, settings of the plant
DrawKey = tuple[str, str, int, int, str, Settings]


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


def draw_key(row: Row) -> DrawKey:
    """Return what identifies the draw of a row, whoever drove it."""
    name = row['drive'] if row['family'] == ENTRIES else ''
    drawn = row['family'], name, row['seed'], row['index'], row['difficulty']
    return *drawn, row['plant_settings']


def proved_by_drives(rows: Iterable[Row]) -> dict[DrawKey, str]:
    """Return the draws that a controller survived, with the first one that did."""
    proved: dict[DrawKey, str] = {}
    for row in rows:
        if row['survived'] is True:
            proved.setdefault(draw_key(row), row['controller'])
    return proved


def verdict_key(draw: DrawKey, budget: int, preview: bool) -> str:
    """Return the SHA-256 of what decides a verdict: scenario, plant, budget, version of the search.

    The code of the controllers is no part of it: a drive that survived stays a proof.
    """
    setup = library_drive.prepare(_drive(draw, DRIVERS[0]))
    content = [SEARCH_VERSION, setup.scn.text, repr(setup.plant), setup.friction, budget, preview]
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def verdict(draw: DrawKey, budget: int, preview: bool) -> str:
    """Return {'answer': ..., 'how': ..., 'rollouts': ...} of a draw as JSON."""
    setups = [library_drive.prepare(_drive(draw, driver)) for driver in DRIVERS]
    drivers = [setup.params for setup in setups]
    result = survivable(setups[0], budget, preview=preview, drivers=drivers)
    return json.dumps({'answer': result.answer, 'how': result.how, 'rollouts': result.rollouts})


def _drive(draw, driver):
    (controller,) = library_drive.find_controllers([driver])
    *drawn, plant_settings = draw
    return LibraryDrive(*drawn, str(controller.config), plant_settings)


def count_regret(rows: Sequence[Row], answers: Mapping[DrawKey, str]) -> list[Regret]:
    """Return the families of the rows in their order, then all of them if there are several.

    answers  by draw; a draw without one counts as undecided
    """
    families = list(dict.fromkeys(row['family'] for row in rows))
    names = [*families, ALL] if len(families) > 1 else families
    return [_count_family(name, rows, answers) for name in names]


def _count_family(family, rows, answers):
    own = [row for row in rows if family in (ALL, row['family']) and not row['error']]
    controllers = list(dict.fromkeys(row['controller'] for row in rows))
    by_draw = {draw_key(row): answers.get(draw_key(row), UNDECIDED) for row in own}
    kinds = (POSSIBLE, IMPOSSIBLE, UNDECIDED)

    def count(controller, condition):
        return sum(row['controller'] == controller and condition(row) for row in own)

    def answer(row):
        return by_draw[draw_key(row)]

    return Regret(
        family,
        {kind: sum(value == kind for value in by_draw.values()) for kind in kinds},
        {c: count(c, lambda row: row['survived'] is True) for c in controllers},
        {c: count(c, lambda row: answer(row) == POSSIBLE) for c in controllers},
        {c: count(c, lambda row: answer(row) != IMPOSSIBLE) for c in controllers},
    )


def lost_though_possible(
    rows: Sequence[Row], answers: Mapping[DrawKey, str], controller: str
) -> Iterator[tuple[Row, str]]:
    """Yield the rows that a controller lost: POSSIBLE draws first, then UNDECIDED ones."""
    for kind in (POSSIBLE, UNDECIDED):
        for row in rows:
            lost = row['controller'] == controller and row['survived'] is not True
            if lost and answers.get(draw_key(row), UNDECIDED) == kind:
                yield row, kind


def pair(rows: Sequence[Row], base: str, other: str) -> Pairs:
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
