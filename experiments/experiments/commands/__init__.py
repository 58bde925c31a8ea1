"""The subcommands of `experiments`, a module each: HELP, add_arguments(parser), run(chosen).

What a command stands on is imported when it runs: `experiments --help` answers at once.
"""
