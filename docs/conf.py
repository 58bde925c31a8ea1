"""Sphinx configuration of the documentation site: `make docs` builds it into build/docs/html."""

import importlib.metadata
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / '_extensions'))

project = 'mpcc'
author = 'The maintainers of this repository'
copyright = author
release = importlib.metadata.version('mpcc_controller')
html_title = 'MPCC for obstacle avoidance'

extensions = [
    'myst_nb',
    'sphinx.ext.autodoc',
    'sphinx.ext.mathjax',
    'sphinx.ext.viewcode',
    'sphinx_copybutton',
    'offline_mathjax',
    'outside_links',
    'plain_docstrings',
    'api_pages',
    'reference_pages',
    'python_links',
]
source_suffix = {'.md': 'myst-nb', '.ipynb': 'myst-nb', '.rst': 'restructuredtext'}
exclude_patterns = ['_extensions', '**/.ipynb_checkpoints']
html_theme = 'furo'
html_static_path = ['_static']
html_css_files = ['site.css']
html_copy_source = False
html_show_sourcelink = False
pygments_style = 'friendly'
pygments_dark_style = 'monokai'
copybutton_exclude = '.linenos, .gp, .go'

# their output is in them (`make notebooks`)
nb_execution_mode = 'off'
myst_enable_extensions = ['attrs_block', 'deflist', 'dollarmath']
myst_heading_anchors = 4
myst_dmath_double_inline = True
myst_dmath_allow_digits = False

autodoc_default_options = {'members': True, 'member-order': 'bysource'}
autodoc_typehints_format = 'short'
autodoc_inherit_docstrings = False
python_maximum_signature_line_length = 88
# the table of contents of a page has its modules; with every function it takes minutes to build
toc_object_entries = False
add_module_names = False
