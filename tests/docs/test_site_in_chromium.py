"""The built site as a reader opens it: from a file, in headless Chromium, without a network."""

import re
import subprocess

import pytest
from capabilities import SITE, chromium

pytestmark = [pytest.mark.site, pytest.mark.needs('chromium'), pytest.mark.needs('site')]
EQUATION = 'class="math notranslate'
FLAGS = (
    *('--headless', '--no-sandbox', '--disable-gpu', '--no-first-run'),
    *('--disable-background-networking', '--host-resolver-rules=MAP * ~NOTFOUND'),
    # of the page's own time: until its scripts are done, however slow the machine is
    '--virtual-time-budget=60000',
)
LOADED = re.compile(r'<(?:script|img|iframe)\b[^>]*\bsrc="([^"]+)"|<link\b[^>]*\bhref="([^"]+)"')


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


def test_every_equation_is_drawn(dom):
    files = [file for file in SITE.parent.rglob('*.html') if EQUATION in file.read_text()]
    pages = [file.relative_to(SITE.parent).as_posix() for file in files]
    assert 'explanation/theory.html' in pages
    for page in pages:
        drawn = dom(page)
        assert drawn.count('<mjx-container') == drawn.count(EQUATION), page
        assert 'data-mjx-error' not in drawn, page


def test_the_search_finds_a_word_of_a_written_and_of_a_generated_page(dom):
    links = re.findall(r'<li[^>]*><a href="([^"#?]+)', dom('search.html?q=contouring'))
    assert any(link.startswith('explanation/theory.html') for link in links), links
    assert any(link.startswith('generated/reference/') for link in links), links


def test_no_page_needs_a_network():
    pages = list(SITE.parent.rglob('*.html'))
    assert len(pages) > 80
    for page in pages:
        for link in map(''.join, LOADED.findall(page.read_text())):
            assert re.match(r'data:|[^:]*(#|\?|$)', link), f'{page.name}: {link}'
