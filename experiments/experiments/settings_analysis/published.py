"""What the decided runs of a folder say, in the blocks of pages: decide, then write every page."""

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from bags.errors import BagError
from experiments import page_block
from experiments.settings.preregistration import RUNS
from experiments.settings_analysis import (
    accepted_rows,
    decision_report,
    outcome_report,
    study_tables,
)
from experiments.settings_analysis.study_tables import POOLED

# by name of the block; takes the folder of the decided runs, and the root of the repository as a
# path relative to the page
BLOCKS: Mapping[str, Callable[[Path, str], str]] = {
    'who avoids': outcome_report.avoidance_text,
    'early braking': outcome_report.braking_text,
}


def decide(folders: Sequence[Path], out: Path) -> list[Path]:
    """Decide each study into the folder of its run; the two that count as one, too.

    The confirmatory run and its repetition are pooled where both are given. The rows of the
    accepted settings are written beside the claims. Returns the paths.
    Raises BagError, before anything is written, for two studies of a run, and for one of another
    seed, number of settings or screening than a preregistered run has.
    """
    runs: dict[str, Path] = {}
    for folder in folders:
        study = study_tables.load(folder)
        if study.otherwise_driven:
            what = '; '.join(study.otherwise_driven)
            raise BagError(f'{folder}: the run is not as preregistered: {what}')
        name = study.run
        if name in runs:
            raise BagError(f'{folder}: is of the run {name}, as {runs[name]} is')
        runs[name] = folder
    paths = []
    for name, folder in runs.items():
        paths += decision_report.run([folder], out / name)
        paths.append(accepted_rows.write(study_tables.load(folder), out / name))
    both = [runs[name] for name in RUNS[:2] if name in runs]
    if len(both) == 2:
        paths += decision_report.run(both, out / POOLED)
    return paths


def write(out: Path, pages: Sequence[Path]) -> list[Path]:
    """Write every block of the pages anew from the decided runs in `out`; return the pages.

    Raises BagError for a page without such a block.
    """
    for page in pages:
        for name, text in build(out, page).items():
            page_block.replace(page, name, f'\n{text}')
    return list(pages)


def build(out: Path, page: Path) -> dict[str, str]:
    """Return the text of each block that a page has, by name. Raises BagError."""
    try:
        content = page.read_text(encoding='utf-8')
    except OSError as error:
        raise BagError(f'{page}: {error.strerror}') from None
    root = Path(os.path.relpath(out.parent.parent, page.parent)).as_posix()
    names = [name for name in BLOCKS if page_block.marks(name)[0] in content]
    if not names:
        blocks = ', '.join(page_block.marks(name)[0] for name in BLOCKS)
        raise BagError(f'{page}: has no block about the study; allowed {blocks}')
    return {name: BLOCKS[name](out, root) for name in names}
