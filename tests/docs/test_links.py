"""Links between files of the repository: relative, to files and headings that exist.

So they work on the page view of a repository and in an editor, and on the site, whose build fails
for a link that leads nowhere there.
"""

import re
import subprocess
from collections import Counter
from functools import cache
from pathlib import Path
from urllib.parse import unquote

import pytest

ROOT = Path(__file__).parents[2]
FENCE = re.compile(r'^( *)(```+|~~~+).*?^\1\2 *$', re.MULTILINE | re.DOTALL)
CODE = re.compile(r'(`+)(?!`).+?(?<!`)\1(?!`)', re.DOTALL)
# [text](target) and ![text](target), also with a line break in the text or before the target
LINK = re.compile(r'\]\(\s*<?([^)\s>]+)>?(?:\s+"[^"]*")?\s*\)|^ {0,3}\[[^\]\n]+\]: *(\S+)', re.M)
HEADING = re.compile(r'^#{1,6} +(.+?)(?: +#+)?$', re.MULTILINE)
OUTSIDE = re.compile(r'[a-z][a-z0-9+.-]*:', re.IGNORECASE)  # https:, mailto:
TRACKED = ['git', '-C', ROOT, 'ls-files', '--cached', '--others', '--exclude-standard']
FILES = subprocess.check_output(TRACKED, text=True).splitlines()
FOLDERS = {str(folder) for name in FILES for folder in Path(name).parents}


@cache
def anchors(page):
    """Return the anchors of the headings of a page, as repositories and the site make them."""
    seen, slugs = Counter(), set()
    for heading in HEADING.findall(FENCE.sub('', page.read_text())):
        plain = re.sub(r'!?\[([^\]]*)\]\([^)]*\)', r'\1', heading)
        slug = re.sub(r'[^\w\- ]', '', plain.strip().lower()).replace(' ', '-')
        slugs.add(f'{slug}-{seen[slug]}' if seen[slug] else slug)
        seen[slug] += 1
    return slugs


def fault(page, target):
    """Return what is wrong with a link of a page, '' if nothing is."""
    if target.startswith('/'):
        return 'is not relative: it works on the site only'
    path, _, anchor = unquote(target).partition('#')
    file = (page.parent / path).resolve() if path else page
    if not file.is_relative_to(ROOT):
        return 'leaves the repository'
    if file.relative_to(ROOT).as_posix() not in {*FILES, *FOLDERS}:
        return 'is not in the repository'
    if anchor and file.suffix == '.md' and anchor not in anchors(file):
        return 'has no such heading'
    return ''


@pytest.mark.parametrize('page', [name for name in FILES if name.endswith('.md')])
def test_every_internal_link_leads_somewhere(page):
    plain = CODE.sub('code', FENCE.sub('', (ROOT / page).read_text()))
    targets = [''.join(groups) for groups in LINK.findall(plain)]
    inside = [target for target in targets if not OUTSIDE.match(target)]
    assert inside or page != 'README.md'
    assert {target: what for target in inside if (what := fault(ROOT / page, target))} == {}
