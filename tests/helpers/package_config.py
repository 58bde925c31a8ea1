"""The data file of a package `some_pkg`, see the fixture `installed`."""


def write_config(prefix, text):
    """Write config/a.yaml of the package below a prefix; return its path."""
    file = prefix / 'share/some_pkg/config/a.yaml'
    file.parent.mkdir(parents=True)
    file.write_text(text)
    return file
