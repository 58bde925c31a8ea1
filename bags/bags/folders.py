"""Where a run is recorded, and where it ends up: an older run stays until the new one is whole."""

import shutil
import tempfile
from pathlib import Path

LOGS = 'logs'


class Workshop:
    """A hidden folder beside the final place, so that moving is one rename.

    bag     folder that the recorder makes
    logs    what the nodes said, and the parameters they were given
    """

    def __init__(self, scenario_folder: Path, name: str):
        scenario_folder.mkdir(parents=True, exist_ok=True)
        self.final = scenario_folder / name
        self.failed = scenario_folder / f'{name}.failed'
        self.root = Path(tempfile.mkdtemp(prefix=f'.{name}.', dir=scenario_folder))
        self.bag = self.root / name
        self.logs = self.root / LOGS
        self.logs.mkdir()

    @property
    def is_closed(self) -> bool:
        """Tell whether the recorder completed the bag."""
        return (self.bag / 'metadata.yaml').is_file()

    def keep(self) -> Path:
        """Put the bag with its logs in the final place; return it."""
        self.logs.rename(self.bag / LOGS)
        return self._replace(self.final, self.bag)

    def set_aside(self) -> Path:
        """Put everything beside the final place for a look at what went wrong; return the logs."""
        return self._replace(self.failed, self.root) / LOGS

    def _replace(self, place, new):
        old = Path(tempfile.mkdtemp(prefix='.old.', dir=place.parent))
        if place.exists():
            place.rename(old / place.name)
        new.rename(place)
        shutil.rmtree(old)
        self.discard()
        return place

    def discard(self):
        """Remove what was not kept."""
        shutil.rmtree(self.root, ignore_errors=True)
