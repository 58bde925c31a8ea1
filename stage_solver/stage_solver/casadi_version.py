"""CasADi 3.7 or newer is needed: older ones hold Python's lock during a whole solve."""

import casadi as ca

OLDEST = (3, 7)


class CasadiTooOldError(ImportError):
    """The installed CasADi cannot run the controller."""


def check(version: str = ca.__version__) -> None:
    """Raise CasadiTooOldError, saying how to upgrade, when `version` is older than OLDEST."""
    major, minor, *_ = version.split('.')
    if (int(major), int(minor)) < OLDEST:
        needed = '.'.join(map(str, OLDEST))
        raise CasadiTooOldError(
            f'CasADi {version} is too old: {needed} or newer is needed, because older ones keep '
            f"Python's lock during a solve and stall every other thread of the node. "
            f"Upgrade with: pip install --upgrade 'casadi>={needed}'"
        )
