"""The recorder's health in one line and a few numbers: /diagnostics."""

from collections.abc import Mapping

from bags.storage.losses import Losses
from msgs_yaml import contract
from msgs_yaml.types import Health
from node_runtime.ages import OK, STALE, WARN, Held

NODE = 'recorder'
NONE = 'none'


class Monitor:
    """Tells the health of a recording; what was lost counts for a while (`ages.Held`)."""

    def __init__(self, mode: str):
        """In `mode` the contract says which topics nodes publish by themselves."""
        topics = contract.load().topics.values()
        self._expected = [one.name for one in topics if one.rate_hz[mode]]
        self._lost = 0  # when it was told last
        self._held = Held()

    def health(self, stamp_ns: int, counted: Mapping[str, Losses]) -> Health:
        """Return the health at a stamp; `counted` has what is known of every topic so far."""
        received = sum(one.received for one in counted.values())
        lost = sum(one.lost or 0 for one in counted.values())
        more, self._lost = lost > self._lost, lost
        level = self._held.take(WARN if more else OK if received else STALE, stamp_ns)
        silent = [name for name in self._expected if not counted[name].received]
        values = {'messages': received, 'lost': lost, 'silent': ' '.join(silent) or NONE}
        return Health(stamp_ns, NODE, level, _TOLD[level], values)


_TOLD = {
    OK: 'recording',
    WARN: 'messages were lost: the recorder or the network is too slow',
    STALE: 'nothing has been heard yet',
}
