"""The subcommands of `bags`, a module each: HELP, add_arguments(parser), run(chosen) -> exit code.

What a command stands on is imported when it runs: `bags --help` answers at once.
"""
