"""Earlier runs that new ones are compared with: found by name or path, checked before the drive."""

import os
from collections.abc import Sequence
from pathlib import Path

from bags.errors import BagError
from bags.storage import read
from experiments.run.node_graph import RunOutcome
from msgs_yaml.strict_yaml import closest
from node_runtime import provenance
from scenario_publisher.scenario import Scenario


def find(names: Sequence[str], folder: Path, scn: Scenario) -> list[Path]:
    """Return the folders of the named runs; a name without a separator is in `folder`.

    Raises BagError for one that does not exist, is no bag, or drove another scenario.
    """
    paths = []
    for name in names:
        path = Path(os.path.expanduser(name)) if os.sep in name else folder / name
        if not path.exists():
            runs = sorted(bag.parent.name for bag in folder.glob('*/metadata.yaml'))
            there = f'; there are {", ".join(runs)}' if runs else '; there is none yet'
            raise BagError(
                f'--beside {name}: no run {os.path.relpath(path)}{there}{closest(name, runs)}'
            )
        info = read.run_info(path)
        if info.get('scenario_sha256') != provenance.digest(scn.text):
            what = info.get('scenario', 'an unknown one')
            same = what == scn.name
            which = f'another version of {what}' if same else f'another scenario, {what}'
            raise BagError(
                f'--beside {name}: {os.path.relpath(path)} drove {which}; drive its controller in '
                'this one too (a second --controller)'
            )
        paths.append(path)
    return paths


def describe_other_plants(paths: Sequence[Path]) -> list[str]:
    """Return a line for each run that drove another plant than the first, and what differs."""
    # imported late: pages and figures take a second to load
    from bags.report.comparability import describe_plants

    first, *others = paths
    reference = read.run_info(first)
    differing = {path: describe_plants(reference, read.run_info(path)) for path in others}
    return [
        f'{path.name} drove another plant than {first.name}: {what}; what differs between them is '
        f'not of the controllers alone. To compare controllers, drive {path.name} once more with '
        'the plant of the others (the same --set plant. options; for another car also its '
        '--set controller.car_file, or --any-car) and a --label of its own'
        for path, what in differing.items()
        if what
    ]


def with_new_runs(others: Sequence[Path], outcomes: Sequence[RunOutcome]) -> list[Path]:
    """Return the folders of new runs and of those to compare with, which may have got a number.

    One that a new run repeated is that run.
    """
    new = {os.path.abspath(outcome.bag): outcome for outcome in outcomes if outcome.bag}
    paths = [outcome.bag for outcome in new.values()]
    for other in others:
        replaced = new.get(os.path.abspath(other))
        place = replaced.older if replaced else other
        if place and place not in paths:
            paths.append(place)
    return paths
