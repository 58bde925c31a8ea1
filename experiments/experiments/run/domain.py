"""Reservation of a ROS domain that is unused on this machine."""

import fcntl
import os
import socket
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from bags.errors import BagError

LAST = 101  # beyond it the ports meet the range that Linux gives to clients
HIGHEST = 232  # beyond it there are no ports
PORT_BASE, PORTS_PER_DOMAIN, FIRST_UNICAST = 7400, 250, 10  # DDSI-RTPS 2.2, section 9.6.1
PORTS_PER_PARTICIPANT, PARTICIPANTS = 2, 10  # so many ports are probed


@contextmanager
def reserved(environment: Mapping[str, str]) -> Iterator[int]:
    """Yield the ROS_DOMAIN_ID of `environment`, or a free one, reserved while in use.

    Free means that no participant listens on its discovery ports and no other run holds its lock
    file: the nodes of two runs in one domain would answer each other. In a given domain other
    participants (viewers) are allowed, so only the lock counts. Raises BagError when the given
    domain or all domains are taken.
    """
    given = environment.get('ROS_DOMAIN_ID')
    # start at different domains: runs started together do not all try the same one first
    candidates = ((os.getpid() + k) % LAST + 1 for k in range(LAST))
    for domain in (_number(given),) if given else candidates:
        lock = _lock(domain)
        if lock is None:
            continue
        with lock:
            if given or _is_silent(domain):
                yield domain
                return
    if given:
        raise BagError(
            f'ROS_DOMAIN_ID={given}: another run uses this domain, and the nodes of two runs would '
            'answer each other; choose another one, or unset it to be given a free one'
        )
    raise BagError(f'all ROS domains from 1 to {LAST} are in use; set ROS_DOMAIN_ID')


def describe_others(environment: Mapping[str, str]) -> str:
    """Return a warning of participants in the ROS_DOMAIN_ID of `environment`, '' without any."""
    given = environment.get('ROS_DOMAIN_ID')
    if not given or _is_silent(_number(given)):
        return ''
    return (
        f'other programs are in ROS_DOMAIN_ID={given}: viewers do no harm, but a plant or a '
        'controller among them, also of another user, would answer these nodes'
    )


def _number(given):
    if not given.isdecimal() or int(given) > HIGHEST:
        raise BagError(f'ROS_DOMAIN_ID={given}: must be a whole number from 0 to {HIGHEST}')
    return int(given)


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


def _is_silent(domain):
    first = PORT_BASE + PORTS_PER_DOMAIN * domain + FIRST_UNICAST
    for k in range(PARTICIPANTS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(('', first + PORTS_PER_PARTICIPANT * k))
            except OSError:
                return False
    return True
