"""Links between files of the repository: relative, to files and headings that exist.

So they work on the page view of a repository and in an editor, and on the site, whose build follows
the same links (`outside_links`).
"""

import re
from collections import Counter
from functools import cache
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[2]
NOT_OURS = ('.venv', 'build', 'dist', 'install', 'log', 'generated', 'node_modules')
FENCE = re.compile(r'^( *)(```+|~~~+).*?^\1\2 *$', re.MULTILINE | re.DOTALL)
CODE = re.compile(r'(`+)(?!`).+?(?<!`)\1(?!`)', re.DOTALL)
# [text](target) and ![text](target), also with a line break in the text or before the target
LINK = re.compile(r'\]\(\s*<?([^)\s>]+)>?(?:\s+"[^"]*")?\s*\)')
REFERENCE = re.compile(r'^ {0,3}\[[^\]\n]+\]: *(\S+)', re.MULTILINE)
HEADING = re.compile(r'^#{1,6} +(.+?)(?: +#+)?$', re.MULTILINE)
OUTSIDE = re.compile(r'[a-z][a-z0-9+.-]*:', re.IGNORECASE)  # https:, mailto:


def is_ours(path):
    parts = path.relative_to(ROOT).parts
    return not any(part in NOT_OURS or part.startswith('.venv') for part in parts)


PAGES = sorted(path for path in ROOT.rglob('*.md') if is_ours(path))


def without_code(text):
    """Return the text with blocks of code left out, and code in a line as 'code'."""
    return FENCE.sub('', text)


@cache
def anchors(page):
    """Return the anchors of the headings of a page, as repositories and the site make them."""
    seen, found = Counter(), set()
    for heading in HEADING.findall(without_code(page.read_text())):
        plain = re.sub(r'!?\[([^\]]*)\]\([^)]*\)', r'\1', heading)
        slug = re.sub(r'[^\w\- ]', '', plain.strip().lower()).replace(' ', '-')
        found.add(f'{slug}-{seen[slug]}' if seen[slug] else slug)
        seen[slug] += 1
    return found


def fault(page, target):
    """Return what is wrong with a link of a page, '' if nothing is."""
    if target.startswith('/'):
        return 'is not relative: it works on the site only'
    path, _, anchor = unquote(target).partition('#')
    file = (page.parent / path).resolve() if path else page
    if not file.is_relative_to(ROOT):
        return 'leaves the repository'
    if not is_ours(file):
        return 'is not in the repository, it is built'
    if not file.exists():
        return 'does not exist'
    if anchor and file.suffix == '.md' and anchor not in anchors(file):
        return 'has no such heading'
    return ''


def internal_links(text):
    plain = CODE.sub('code', without_code(text))
    return [
        target
        for target in (*LINK.findall(plain), *REFERENCE.findall(plain))
        if not OUTSIDE.match(target)
    ]


def test_there_are_pages_with_links():
    names = {path.relative_to(ROOT).as_posix() for path in PAGES}
    assert {'README.md', 'CONTRIBUTING.md', 'docs/index.md', 'docs/howto/launch.md'} <= names
    assert sum(len(internal_links(path.read_text())) for path in PAGES) > 200


@pytest.mark.parametrize('page', PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_internal_link_leads_somewhere(page):
    links = internal_links(page.read_text())
    assert {target: what for target in links if (what := fault(page, target))} == {}


@pytest.mark.parametrize(
    ('target', 'what'),
    [
        ('/safety.md', 'is not relative: it works on the site only'),
        ('nothing.md', 'does not exist'),
        ('../../elsewhere.md', 'leaves the repository'),
        ('generated/reference/topics.md', 'is not in the repository, it is built'),
        ('plant.md#no-such-heading', 'has no such heading'),
        ('#no-such-heading', 'has no such heading'),
        ('plant.md', ''),
        ('../README.md', ''),
    ],
)
def test_a_dead_link_is_found(target, what):
    assert fault(ROOT / 'docs/solver.md', target) == what


def test_links_in_code_are_none():
    text = '`[a](b.md)` [c](d.md) ```x``` [`e`](f.md)\n\n```\n[g](h.md)\n```\n[i\nj](k.md#l)'
    assert internal_links(text) == ['d.md', 'f.md', 'k.md#l']
