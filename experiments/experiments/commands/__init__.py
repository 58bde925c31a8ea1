"""The subcommands of `experiments`, one module each, with HELP, EXAMPLE, add_arguments and run.

Modules import what they need in `run`, so that `experiments --help` answers at once.
"""
