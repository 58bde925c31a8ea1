"""Equations without a network: one file of MathJax is copied into the site.

Of the MathJax builds that the distribution sphinx-mathjax-offline holds, the site takes the one
that draws glyphs as SVG: it loads no fonts, which browsers refuse to pages of file://.
"""

import shutil
from importlib import metadata
from pathlib import Path

DISTRIBUTION = 'sphinx-mathjax-offline'
BUILD = 'tex-svg.js'
FOLDER = 'mathjax'


def find_mathjax() -> Path:
    """Return the path of the MathJax build; raise FileNotFoundError where it is not installed."""
    for file in metadata.files(DISTRIBUTION) or ():
        if file.name == BUILD:
            return Path(file.locate())
    raise FileNotFoundError(f'{DISTRIBUTION} has no {BUILD}; docs/requirements.txt pins it')


def _copy(app, exception):
    if exception is None and app.builder.format == 'html':
        target = Path(app.outdir, '_static', FOLDER, BUILD)
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(find_mathjax(), target)


def setup(app):
    """Register the copy at the end of a build."""
    app.config.mathjax_path = f'{FOLDER}/{BUILD}'
    app.connect('build-finished', _copy)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
