"""Links of pages to files of the repository outside docs/.

On GitHub and in an editor `[benchmarks](../bench/solver.md)` opens the file. On the site a
Markdown file outside docs/ becomes a page of its own below generated/repository/; any other file
can be downloaded. A link to a file that does not exist is a warning.
"""

import os
import posixpath
import re
from pathlib import Path

FOLDER = 'generated/repository'
# [text](target) and ![text](target), not across a blank line
LINK = re.compile(r'(?P<before>\]\()(?P<path>[^)\s#:]+)(?P<anchor>#[^)\s]*)?(?P<after>\))')
FENCE = re.compile(r'^ *(```|~~~|:::)')


def outside(docs: Path, page: Path, target: str) -> Path | None:
    """Return the file outside docs that a link of a page names, None for a link inside docs."""
    path = Path(os.path.normpath(page.parent / target))
    return None if path.is_relative_to(docs) else path


def rewrite(docs: Path, page: Path, written_as: str, text: str, found: set[Path]) -> str:
    """Return the text of a page with links for the site; add the linked Markdown files to `found`.

    `page` is where the text stands in the repository, `written_as` the path of its page in docs.
    """

    def link(match):
        target = match['path']
        if target.startswith('/'):
            return match[0]
        path = outside(docs, page, target)
        here = posixpath.dirname(written_as)
        if path is None:
            inside = Path(os.path.normpath(page.parent / target)).relative_to(docs)
            new = posixpath.relpath(inside.as_posix(), here)
        elif path.suffix == '.md' and path.is_file():
            found.add(path)
            new = posixpath.relpath(f'{FOLDER}/{path.relative_to(docs.parent).as_posix()}', here)
        else:
            new = os.path.relpath(path, docs / here)
        return f'{match["before"]}{new}{match["anchor"] or ""}{match["after"]}'

    lines, fence = [], None
    for line in text.splitlines(keepends=True):
        mark = FENCE.match(line)
        if mark and mark[1] != ':::':
            fence = None if fence == mark[1] else fence or mark[1]
        lines.append(line if fence else LINK.sub(link, line))
    return ''.join(lines)


def write_pages(docs: Path) -> list[Path]:
    """Write a page for every Markdown file outside docs that pages or such files link to.

    Returns the files of the repository. Pages that are already as they should be are not touched.
    """
    target = docs / FOLDER
    waiting, done = set(), {}
    for page in docs.rglob('*.md'):
        if not page.is_relative_to(docs / 'generated'):
            name = page.relative_to(docs).as_posix()
            rewrite(docs, page, name, page.read_text(), waiting)
    while waiting:
        file = waiting.pop()
        name = f'{FOLDER}/{file.relative_to(docs.parent).as_posix()}'
        found: set[Path] = set()
        done[file] = rewrite(docs, file, name, file.read_text(), found)
        waiting |= found - done.keys()
    for file, text in done.items():
        write_if_changed(target / file.relative_to(docs.parent), text)
    return sorted(done)


def write_if_changed(path: Path, text: str) -> None:
    """Write a generated page; leave it alone where it holds the text already."""
    if path.is_file() and path.read_text() == text:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def _write_pages(app):
    write_pages(Path(app.srcdir))


def _rewrite(app, docname, source):
    path = Path(app.env.doc2path(docname))
    docs = Path(app.srcdir)
    if path.suffix == '.md' and not path.is_relative_to(docs / 'generated'):
        name = path.relative_to(docs).as_posix()
        source[0] = rewrite(docs, path, name, source[0], set())


def setup(app):
    """Register the pages before reading and the links while reading."""
    app.connect('builder-inited', _write_pages)
    app.connect('source-read', _rewrite)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
