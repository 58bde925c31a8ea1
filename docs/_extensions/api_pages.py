"""A page per folder of the packages, with every public name of its modules, for autodoc."""

from pathlib import Path

from outside_links import write_if_changed

FOLDER = 'generated/api'


def folders(root: Path) -> dict[str, list[str]]:
    """Return the modules of every folder of the packages below `root`, by dotted name.

    The modules of commands are left out: their help is on another page.
    """
    found = {}
    for manifest in sorted(root.glob('*/package.xml')):
        source = manifest.parent
        package = source.name
        for init in sorted((source / package).rglob('__init__.py')):
            folder = init.parent
            if folder.name != 'commands':
                name = '.'.join(folder.relative_to(source).parts)
                stems = sorted(file.stem for file in folder.glob('*.py') if file != init)
                found[name] = [f'{name}.{stem}' for stem in stems]
    return found


def page(folder: str, modules: list[str]) -> str:
    """Return the page of a folder as reStructuredText."""
    parts = [_title(folder, '='), f'.. automodule:: {folder}\n   :no-members:\n']
    for module in modules:
        parts += [_title(module.rpartition('.')[2], '-'), f'.. automodule:: {module}\n']
    return '\n'.join(parts)


def _title(text, line):
    return f'{text}\n{line * len(text)}\n'


def write_pages(root: Path, docs: Path) -> None:
    """Write the pages of all folders, and remove those of folders that are no more."""
    found = folders(root)
    for folder, modules in found.items():
        write_if_changed(docs / FOLDER / f'{folder}.rst', page(folder, modules))
    for path in (docs / FOLDER).glob('*.rst'):
        if path.stem not in found:
            path.unlink()


def _write_pages(app):
    docs = Path(app.srcdir)
    write_pages(docs.parent, docs)


def setup(app):
    """Register the pages before reading."""
    app.connect('builder-inited', _write_pages)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
