"""A compiler that optimises nothing, for libraries that are hardly used: a sixth of the time."""


def write(folder):
    """Write it into a folder; return the program."""
    program = folder / 'quick_cc'
    program.write_text('#!/bin/sh\nexec cc "$@" -O0\n')
    program.chmod(0o755)
    return str(program)
