"""The subcommands of `bags`, a module each: HELP, add_arguments(parser), run(args) -> exit code.

A command imports what it needs when it runs, so that `bags --help` is quick.
"""
