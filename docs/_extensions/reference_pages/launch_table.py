"""The page with the arguments of the launch file."""

from experiments.run.launch_arguments import ARGUMENTS
from reference_pages.markdown import code, table, text


def page() -> str:
    """Return the page: a row per argument."""
    rows = [
        (
            code(argument.name),
            code(argument.default),
            ', '.join(map(code, argument.choices or ())),
            text(argument.meaning),
        )
        for argument in ARGUMENTS
    ]
    about = (
        '# Arguments of `ros2 launch experiments closed_loop.launch.py`\n\n'
        '[How to use them](../../howto/launch.md).\n\n'
    )
    return about + table(('argument', 'default', 'allowed', 'meaning'), rows)
