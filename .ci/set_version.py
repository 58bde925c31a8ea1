"""Writes the version, the newest heading of CHANGELOG.md, into the files that have to repeat it.

These are package.xml, setup.cfg and CHANGELOG.rst of each package, and CITATION.cff. Run by `make
version`.
"""

import re
import sys
from datetime import date
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
UNRELEASED = 'unreleased'
FORTHCOMING = 'Forthcoming'  # heading of REP-132 for what is not released yet
HEADING = re.compile(r'^## (\d+\.\d+\.\d+) \((.+)\)$', re.M)
SECTION = re.compile(rf'^({FORTHCOMING}|\d+\.\d+\.\d+ \(.+\))\n-+\n', re.M)


class Release(NamedTuple):
    """A version, and the day of its release as YYYY-MM-DD, '' before that."""

    version: str
    day: str


def newest(changelog: str) -> Release:
    """Return the release of the newest heading, `## 1.2.3 (unreleased)` or `## 1.2.3 (2026-01-31)`.

    Raises ValueError for a text without such a heading.
    """
    found = HEADING.search(changelog)
    if not found:
        raise ValueError('CHANGELOG.md: no heading `## 1.2.3 (unreleased)` or `## 1.2.3 (DATE)`')
    version, day = found.groups()
    if day != UNRELEASED:
        date.fromisoformat(day)  # raises ValueError
    return Release(version, '' if day == UNRELEASED else day)


def manifest(text: str, release: Release) -> str:
    """Return a package.xml with the version of a release."""
    return re.sub(r'(<version>)[^<]*(</version>)', rf'\g<1>{release.version}\g<2>', text, count=1)


def setup(text: str, release: Release) -> str:
    """Return a setup.cfg with the version of a release; colcon reads no setup.py that sets it."""
    return re.sub(r'^version = .*$', f'version = {release.version}', text, count=1, flags=re.M)


def package_changelog(text: str, release: Release) -> str:
    """Return a CHANGELOG.rst whose first section is that of a release.

    What is forthcoming becomes the release; before a release, a released section stays and an
    empty one for what is forthcoming is put before it.
    """
    title = f'{release.version} ({release.day})' if release.day else FORTHCOMING
    section = SECTION.search(text)
    old = section.group(1)
    if old == title:
        return text
    heading = f'{title}\n{"-" * len(title)}\n'
    if old != FORTHCOMING:
        heading += f'\n{section.group(0)}'
    return text[: section.start()] + heading + text[section.end() :]


def citation(text: str, release: Release) -> str:
    """Return a CITATION.cff with version and date of a release."""
    text = re.sub(r'^version: .*$', f'version: {release.version}', text, flags=re.M)
    text = re.sub(r'^date-released: .*\n', '', text, flags=re.M)
    dated = f'version: {release.version}\ndate-released: {release.day}'
    return text.replace(f'version: {release.version}', dated) if release.day else text


def changed(root: Path) -> dict[Path, str]:
    """Return the new text of each file below `root` that does not agree with CHANGELOG.md."""
    release = newest((root / 'CHANGELOG.md').read_text())
    edits = [(path, manifest) for path in root.glob('*/package.xml')]
    edits += [(path, setup) for path in root.glob('*/setup.cfg')]
    edits += [(path, package_changelog) for path in root.glob('*/CHANGELOG.rst')]
    edits.append((root / 'CITATION.cff', citation))
    texts = {path: edit(path.read_text(), release) for path, edit in edits}
    return {path: text for path, text in texts.items() if text != path.read_text()}


def main() -> int:
    """Write the version; print the files that changed."""
    try:
        texts = changed(ROOT)
    except ValueError as error:
        print(error, file=sys.stderr)
        return 1
    for path, text in sorted(texts.items()):
        path.write_text(text)
        print(path.relative_to(ROOT))
    return 0


if __name__ == '__main__':
    sys.exit(main())
