"""Reference pages that are written from the source: nothing in them is typed by hand.

parameter_pages   parameters of nodes, of the files they name, and of the shipped controllers
topic_page        topics of the contract
metric_page       metrics of a comparison
scenario_page     keys of a scenario file
command_pages     help of every command, exit codes
launch_table      arguments of the launch file
markdown          tables and headings
"""

from pathlib import Path

from outside_links import write_if_changed

FOLDER = 'generated/reference'


def pages() -> dict[str, str]:
    """Return every page as MyST Markdown, by its name without an ending."""
    # the packages that are described take a second to load
    from reference_pages import (
        command_pages,
        launch_table,
        metric_page,
        parameter_pages,
        scenario_page,
        topic_page,
    )

    return {
        **parameter_pages.pages(),
        'topics': topic_page.page(),
        'launch_arguments': launch_table.page(),
        'metrics': metric_page.page(),
        'scenario_keys': scenario_page.page(),
        **command_pages.pages(),
    }


def _write_pages(app):
    for name, text in pages().items():
        write_if_changed(Path(app.srcdir, FOLDER, f'{name}.md'), text)


def setup(app):
    """Register the pages before reading."""
    app.connect('builder-inited', _write_pages)
    return {'parallel_read_safe': True, 'parallel_write_safe': True}
