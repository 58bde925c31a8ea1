"""The built site as a reader opens it: from a file, in headless Chromium, without a network."""

import re
import subprocess
from urllib.parse import urlsplit

import pytest
from capabilities import SITE, chromium

pytestmark = [pytest.mark.slow, pytest.mark.needs('chromium'), pytest.mark.needs('site')]
EQUATION = 'class="math notranslate'
FLAGS = (
    *('--headless', '--no-sandbox', '--disable-gpu', '--no-first-run'),
    *('--disable-background-networking', '--host-resolver-rules=MAP * ~NOTFOUND'),
    # of the page's own time: until its scripts are done, however slow the machine is
    '--virtual-time-budget=60000',
)


@pytest.fixture(scope='module')
def dom(tmp_path_factory):
    """Return dom(page): its document when its scripts have run."""
    profile = tmp_path_factory.mktemp('chromium')

    def read(page):
        url = f'{SITE.parent.as_uri()}/{page}'
        command = [chromium(), *FLAGS, f'--user-data-dir={profile}', '--dump-dom', url]
        done = subprocess.run(command, capture_output=True, text=True, timeout=250)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return read


def pages_with_equations():
    pages = SITE.parent.rglob('*.html')
    return sorted(p for p in pages if EQUATION in p.read_text())


def test_every_equation_is_drawn(dom):
    pages = [str(path.relative_to(SITE.parent)) for path in pages_with_equations()]
    assert 'explanation/theory.html' in pages
    for page in pages:
        drawn = dom(page)
        assert drawn.count('<mjx-container') == drawn.count(EQUATION), page
        assert 'data-mjx-error' not in drawn, page


def test_the_search_finds_a_word_of_a_written_and_of_a_generated_page(dom):
    page = dom('search.html?q=contouring')
    found = re.findall(r'<li[^>]*><a href="([^"#?]+)', page)
    assert any(link.startswith('explanation/theory.html') for link in found), found
    assert any(link.startswith('generated/reference/') for link in found), found


def test_no_page_needs_a_network():
    loaded = re.compile(
        r'<(?:script|img|iframe)\b[^>]*\bsrc="([^"]+)"|<link\b[^>]*\bhref="([^"]+)"'
    )
    pages = list(SITE.parent.rglob('*.html'))
    assert len(pages) > 80
    for page in pages:
        for link in map(''.join, loaded.findall(page.read_text())):
            assert urlsplit(link).scheme in ('', 'data'), f'{page.name}: {link}'
