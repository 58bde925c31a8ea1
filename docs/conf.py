"""Sphinx configuration of the documentation site: `make docs` builds it into build/docs/html."""

import importlib.metadata
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / '_extensions'))

project = 'mpcc'
author = 'The maintainers of this repository'
copyright = author
release = importlib.metadata.version('mpcc_controller')
html_title = 'Model predictive contouring control for obstacle avoidance'
html_short_title = 'MPCC'

extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.mathjax',
    'sphinx.ext.viewcode',
    'sphinx_copybutton',
    'sphinx_design',
    'outside_links',
    'offline_mathjax',
]
source_suffix = {'.md': 'markdown', '.rst': 'restructuredtext'}
exclude_patterns = ['_extensions', '**/.ipynb_checkpoints']
suppress_warnings = ['toc.empty_glob']
html_theme = 'furo'
html_static_path = ['_static']
html_copy_source = False
html_show_sourcelink = False
pygments_style = 'friendly'
pygments_dark_style = 'monokai'
copybutton_exclude = '.linenos, .gp, .go'

myst_enable_extensions = ['attrs_block', 'colon_fence', 'deflist', 'dollarmath']
myst_heading_anchors = 4
myst_dmath_double_inline = True
myst_dmath_allow_digits = False
