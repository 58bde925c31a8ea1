"""How the messages of a node travel: by UDP, within this machine unless the user opens it. No ROS.

Shared memory, which Fast DDS prefers by default, does not survive a process that is killed: when
another one takes over its port, a writer may remove the port under the new reader. On a busy
machine, after about one of 80 restarts, the new process then hears some of the others, or none, as
long as it lives (Fast DDS 2.14; `bench/restarts.py`). The kernel cleans up after UDP, and at the
size of our messages it is as fast.
"""

from collections.abc import MutableMapping

from msgs_yaml import share

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
LOCALHOST, SUBNET, BY_PROFILE = 'LOCALHOST', 'SUBNET', 'SYSTEM_DEFAULT'
PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'
FILES = {LOCALHOST: 'fast_dds_localhost.xml', SUBNET: 'fast_dds_subnet.xml'}
# who sets one of these has chosen a transport
CHOICES = (PROFILES, 'FASTDDS_DEFAULT_PROFILES_FILE', 'FASTDDS_BUILTIN_TRANSPORTS')
# rmw_fastrtps applies these to a range that it sets up itself
PEERS, LOCALHOST_ONLY = 'ROS_STATIC_PEERS', 'ROS_LOCALHOST_ONLY'


def configure(environment: MutableMapping[str, str]) -> None:
    """Choose range and transport in the environment of a node that has not been started.

    Without ROS_AUTOMATIC_DISCOVERY_RANGE a node discovers this machine only. For LOCALHOST and
    SUBNET a profile of Fast DDS selects UDP, unless the environment names profiles or built-in
    transports. LOCALHOST then reads SYSTEM_DEFAULT, which leaves the range to the profile:
    rmw_fastrtps adds shared memory to its own LOCALHOST. That one stays in force for named hosts
    (ROS_STATIC_PEERS) and ROS_LOCALHOST_ONLY=1. Other ranges are left alone. A second call changes
    nothing.
    """
    discovery = environment.setdefault(RANGE, LOCALHOST)
    if discovery not in FILES or any(environment.get(name) for name in CHOICES):
        return
    if environment.get(LOCALHOST_ONLY) == '1':
        return
    if discovery == LOCALHOST:
        if environment.get(PEERS):
            return
        environment[RANGE] = BY_PROFILE
    environment[PROFILES] = str(share.path('node_runtime', 'config', FILES[discovery]))
