"""What others read before they use or change the project: declarations, templates, container."""

import re
import subprocess

import pytest
import yaml
from installation import PACKAGES, ROOT

PAGES = ('QUALITY_DECLARATION.md', 'CONTRIBUTING.md', 'SECURITY.md', 'README.md')
TEMPLATES = [
    p for p in sorted((ROOT / '.github/ISSUE_TEMPLATE').glob('*.yml')) if p.stem != 'config'
]


@pytest.mark.parametrize('page', PAGES)
def test_every_file_and_make_target_that_a_page_names_is_there(page):
    text = (ROOT / page).read_text()
    names = re.findall(r'`((?:tests|bench|docs|bags/reference|\.ci)/[\w./]+)`', text)
    assert [name for name in names if not (ROOT / name).exists()] == []
    targets = set(re.findall(r'^([a-z_]+):', (ROOT / 'Makefile').read_text(), re.M))
    assert set(re.findall(r'`?make ([a-z_]+)', text)) <= targets


def test_every_property_sees_new_examples_with_each_commit():
    """As CONTRIBUTING.md says."""
    word = 'derandom' + 'ize'
    assert [str(f) for f in (ROOT / 'tests').rglob('*.py') if word in f.read_text()] == []


def test_the_declaration_has_the_public_api_of_every_package():
    text = (ROOT / 'QUALITY_DECLARATION.md').read_text()
    assert re.findall(r'^\| `(\w+)` \| .+ \| .+ \|$', text, re.M) == [*PACKAGES]


@pytest.mark.parametrize('path', TEMPLATES, ids=lambda path: path.stem)
def test_a_form_for_issues_asks_for_something(path):
    form = yaml.safe_load(path.read_text())
    assert {'name', 'description', 'body'} <= set(form)
    ids = [item['id'] for item in form['body']]
    assert len(set(ids)) == len(ids) > 0
    for item in form['body']:
        assert item['type'] in {'textarea', 'input', 'dropdown', 'checkboxes'}
        assert item['attributes']['label']
        assert ('options' in item['attributes']) == (item['type'] in {'dropdown', 'checkboxes'})


def test_the_container_copies_every_package_and_installs_what_the_guide_for_ubuntu_does():
    text = re.sub(r'^\s*#.*\n', '', (ROOT / 'Dockerfile').read_text(), flags=re.M)
    lines = [line for line in text.replace('\\\n', ' ').splitlines() if line.strip()]
    arguments = [tuple(line.split(maxsplit=1)) for line in lines]
    copies = [argument.split() for keyword, argument in arguments if keyword == 'COPY']
    assert all((ROOT / source).exists() for source, _ in copies)
    for package in PACKAGES:
        assert [package, f'src/{package}'] in copies
        assert [f'{package}/package.xml', f'src/{package}/'] in copies

    scripts = [argument for keyword, argument in arguments if keyword == 'RUN']
    assert len(scripts) > 5
    for script in scripts:
        done = subprocess.run(['bash', '-n', '-c', script], capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, ''), script

    guide = (ROOT / 'docs/howto/packages.md').read_text().replace('\\\n', ' ')
    (by_hand,) = re.findall('^pip install (casadi .*)$', guide, re.M)
    assert next(s for s in scripts if s.startswith('pip install')).split()[2:] == by_hand.split()
    (apt,) = re.findall('^sudo apt install (.*)$', guide, re.M)
    assert ('ARG', 'BASE=ros:jazzy-ros-base-noble') in arguments
    assert set(apt.split()) - {'ros-jazzy-ros-base'} <= set(' '.join(scripts).split())
