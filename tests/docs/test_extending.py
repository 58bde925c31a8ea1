"""The recipes of docs/extending.md, applied to a copy of the packages as the page says."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
import recipe_steps
from installation import PACKAGES

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / 'docs/extending.md').read_text()
STEP = re.compile(r'<!-- (?P<step>.+?) -->\n```\w*\n(?P<text>.*?)```\n', re.DOTALL)
CHECK = 'check'


class Recipe(NamedTuple):
    """The steps of a section, in order: what to do, and the text of its block."""

    title: str
    steps: tuple[tuple[str, str], ...]


def recipes():
    sections = re.split(r'^## ', PAGE, flags=re.MULTILINE)[1:]
    return [
        Recipe(section.partition('\n')[0], tuple(m.group('step', 'text') for m in found))
        for section in sections
        for found in [list(STEP.finditer(section))]
    ]


@pytest.fixture
def copy(tmp_path):
    """Return a folder with the packages as they are in the repository."""
    ignored = shutil.ignore_patterns('__pycache__', 'runs', 'reference', 'build', '*.egg-info')
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tmp_path / package, ignore=ignored)
    return tmp_path


def test_every_section_is_a_recipe_with_a_check():
    titles = [recipe.title for recipe in recipes()]
    assert titles == [
        'A metric',
        'A cost term',
        'A field of a topic',
        'A controller',
        'A formulation',
        'A scenario',
    ]
    for recipe in recipes():
        assert recipe.steps[-1][0] == CHECK
        assert len(recipe.steps) > 1


@pytest.mark.parametrize('recipe', recipes(), ids=lambda recipe: recipe.title.replace(' ', '_'))
def test_a_recipe_does_what_the_page_says(recipe, copy):
    for step, text in recipe.steps[:-1]:
        recipe_steps.apply(step, text, copy)
    paths = os.pathsep.join(str(copy / package) for package in PACKAGES)
    done = subprocess.run(
        [sys.executable, '-c', recipe.steps[-1][1]],
        cwd=copy,
        env=os.environ | {'PYTHONPATH': paths},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr


def test_a_recipe_that_does_nothing_fails(copy):
    """Without its steps every check fails: none of what they look for exists already."""
    paths = os.pathsep.join(str(copy / package) for package in PACKAGES)
    for recipe in recipes():
        done = subprocess.run(
            [sys.executable, '-c', recipe.steps[-1][1]],
            cwd=copy,
            env=os.environ | {'PYTHONPATH': paths},
            capture_output=True,
        )
        assert done.returncode != 0, recipe.title
