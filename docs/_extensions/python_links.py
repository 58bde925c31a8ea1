"""A page that names a module, class or function that does not exist is a warning.

Sphinx leaves an unknown name in a role such as `{py:func}` as text; only annotations of
signatures may stay so, since most of them name other libraries.
"""

from sphinx.util import logging

logger = logging.getLogger(__name__)
GENERATED = 'generated/api/'


def _warn(app, env, node, contnode):
    """Warn of a Python name of a written page that no page of the reference describes."""
    is_written = not env.docname.startswith(GENERATED)
    if node.get('refdomain') == 'py' and is_written:
        logger.warning('no Python name %r', node['reftarget'], location=node, type='ref')


def setup(app):
    """Register the check."""
    app.connect('missing-reference', _warn)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
