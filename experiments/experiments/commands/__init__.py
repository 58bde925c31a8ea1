"""The subcommands of `experiments`, one module each, with HELP, EXAMPLE, add_arguments and run.

Modules import what they need in `run`, so that `experiments --help` answers at once.
"""

import argparse


def positive_number(text: str) -> float:
    """Return the value of an option that must be positive and finite."""
    value = float(text)
    if not 0.0 < value < float('inf'):
        raise argparse.ArgumentTypeError(f'must be positive and finite, is {text}')
    return value
