"""One drive of the library: a draw of a family, or an entry, by one controller.

Its setup is prepared where it is driven; its key is computed before, from the texts that decide it.
"""

import hashlib
import json
from collections.abc import Mapping
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, NamedTuple

from bags.errors import BagError
from experiments import code_version, simulation
from experiments.batch.drive_plan import CHANGED
from experiments.batch.simulate import simulate
from experiments.configuration import node_config
from experiments.simulation import Setup
from msgs_yaml import share
from scenario_publisher import scenario
from scenario_publisher.families import draw
from scenario_publisher.families.draw import Draw
from scenario_publisher.scenario import Scenario

ENTRIES = 'entries'  # stands where a family does
Settings = tuple[tuple[str, str, Any], ...]  # role, dotted name, value


class LibraryDrive(NamedTuple):
    """Which scenario is driven by whom; it can be sent to another process."""

    family: str  # or ENTRIES
    name: str  # of the entry; '' of a draw
    seed: int
    index: int
    difficulty: str
    controller: str  # a name, or the path of a file
    settings: Settings  # of --set; they win over those of the draw

    def __str__(self) -> str:
        return self.name or f'{self.family}:{self.index}'

    @property
    def controller_name(self) -> str:
        """The name in tables: a file that is called like a controller of the package has its path.

        Else its drives would be counted with those of that controller.
        """
        name = Path(self.controller).stem
        shipped = share.path('mpcc_controller', 'config') / f'{name}.yaml'
        return self.controller if shipped.is_file() else name

    @property
    def draw(self) -> Draw:
        """The draw of a family."""
        return draw.draw(self.family, self.seed, self.index, self.difficulty)


def load_scenario(drive: LibraryDrive) -> Scenario:
    """Return the scenario of a drive."""
    return scenario.load(drive.name) if drive.name else drive.draw.scenario()


def prepare(drive: LibraryDrive) -> Setup:
    """Return the setup of a drive. Raises BagError for settings that no node has."""
    scn = load_scenario(drive)
    settings = all_settings(drive)
    return simulation.prepare_scenario(scn, drive.controller, settings)


def all_settings(drive: LibraryDrive) -> dict[str, dict[str, Any]]:
    """Return the parameters by role and dotted name: those of the draw, then those given."""
    drawn: Mapping[str, Mapping[str, Any]] = {} if drive.name else drive.draw.settings
    settings = {role: dict(values) for role, values in drawn.items()}
    for role, name, value in drive.settings:
        settings.setdefault(role, {})[name] = value
    return settings


def settings_text(settings: Settings) -> str:
    """Return the settings of --set as JSON by `NODE.parameter`, equal for equal ones."""
    return json.dumps({f'{role}.{name}': value for role, name, value in sorted(settings)})


def key(drive: LibraryDrive) -> str:
    """Return the SHA-256 of all that decides a drive: scenario, parameters, code, processor."""
    text = scenario.load(drive.name).text if drive.name else drive.draw.text
    content = [code_version.digest(), _parameters(drive.controller, drive.settings), text]
    content.append(sorted((role, sorted(v.items())) for role, v in all_settings(drive).items()))
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


@cache
def _parameters(controller, settings):
    """Return the parameters of controller, car and plant with the given settings, as text.

    Of any scenario: what a draw changes is in the key besides.
    """
    changed: dict[str, dict[str, Any]] = {}
    for role, name, value in settings:
        changed.setdefault(role, {})[name] = value
    setup = simulation.prepare_scenario(_any_scenario(), controller, changed)
    return repr((setup.controller, setup.params, setup.vehicle, setup.plant))


@lru_cache(maxsize=1)
def _any_scenario():
    return scenario.load('straight')


def run(drive: LibraryDrive, wanted_key: str) -> str:
    """Drive once; return the results as JSON, by dotted name (`batch.simulate`).

    Raises BagError where the key of the drive is no longer the one that is wanted.
    """
    setup = prepare(drive)
    _parameters.cache_clear()  # its files may have changed since they were read
    if key(drive) != wanted_key:
        raise BagError(f'{drive}: a file of its inputs has {CHANGED}')
    return simulate(setup)


def find_controllers(names: list[str]) -> list[node_config.Controller]:
    """Return the controllers. Raises BagError for an unknown one."""
    return node_config.find_controllers(names)


def entries() -> list[str]:
    """Return the scenarios that expect something of a run, by name."""
    return [name for name in scenario.available() if scenario.load(name).expect]


def parse_draw(text: str) -> tuple[str, int]:
    """Return family and index of `FAMILY:INDEX`. Raises BagError."""
    family, _, index = text.partition(':')
    if family not in draw.FAMILIES or not index.isdecimal():
        families = ', '.join(draw.FAMILIES)
        raise BagError(f'{text!r} is no draw; allowed FAMILY:INDEX, FAMILY one of {families}')
    return family, int(index)
