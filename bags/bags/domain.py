"""A ROS domain that nobody on this machine uses."""

import fcntl
import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

LAST = 101  # beyond it the ports meet the range that Linux gives to clients
PORT_BASE, PORTS_PER_DOMAIN, FIRST_UNICAST = 7400, 250, 10  # DDSI-RTPS 2.2, section 9.6.1


@contextmanager
def reserved(environment) -> Iterator[int]:
    """Yield the ROS_DOMAIN_ID of `environment`, or one that is free, reserved while in use.

    Free means that no participant listens on its first discovery port, and that no other run holds
    its lock file. Raises RuntimeError when all are taken.
    """
    given = environment.get('ROS_DOMAIN_ID')
    if given:
        yield int(given)
        return
    # begin anywhere: runs started together do not all try the same one first
    for domain in ((os.getpid() + k) % LAST + 1 for k in range(LAST)):
        lock = _lock(domain)
        if lock is None:
            continue
        with lock:
            if _silent(domain):
                yield domain
                return
    raise RuntimeError(f'all ROS domains from 1 to {LAST} are in use; set ROS_DOMAIN_ID')


def _lock(domain):
    """Return the open, locked file of a domain, or None when another run holds it."""
    path = Path(tempfile.gettempdir(), f'bags_run_{os.getuid()}_domain_{domain}.lock')
    handle = path.open('w')
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        handle.close()
        return None
    return handle


def _silent(domain):
    port = PORT_BASE + PORTS_PER_DOMAIN * domain + FIRST_UNICAST
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(('', port))
        except OSError:
            return False
    return True
