"""What processes call in place of a drive: on some roads the drive goes wrong."""

import os
import signal

from experiments import drive_row

CRASHES, HANGS, RAISES = 0.5, 0.7, 0.8  # friction of the road


def drive_or_fail(setup):
    """Simulate, unless the friction of the road is one of the above."""
    if setup.friction == CRASHES:
        os.kill(os.getpid(), signal.SIGSEGV)
    if setup.friction == RAISES:
        raise ZeroDivisionError('nothing\nto divide by')
    while setup.friction == HANGS:
        signal.pause()
    return drive_row.drive(setup)
