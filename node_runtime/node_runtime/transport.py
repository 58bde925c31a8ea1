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
FAST_DDS = 'rmw_fastrtps'  # begins the names of its middleware interfaces
# who sets one of these has chosen a transport
CHOICES = (PROFILES, 'FASTDDS_DEFAULT_PROFILES_FILE', 'FASTDDS_BUILTIN_TRANSPORTS')
# rmw_fastrtps applies these to a range that it sets up itself
PEERS, LOCALHOST_ONLY = 'ROS_STATIC_PEERS', 'ROS_LOCALHOST_ONLY'


def configure(environment: MutableMapping[str, str], middleware: str) -> None:
    """Choose range and transport in the environment of this process, before rclpy is initialised.

    Without ROS_AUTOMATIC_DISCOVERY_RANGE a node discovers this machine only. With Fast DDS, for
    LOCALHOST and SUBNET, a profile selects UDP, unless the environment names profiles or built-in
    transports. LOCALHOST then reads SYSTEM_DEFAULT, which leaves the range to the profile:
    rmw_fastrtps adds shared memory to its own LOCALHOST. That one stays in force for named hosts
    (ROS_STATIC_PEERS) and ROS_LOCALHOST_ONLY=1. Other ranges and other middlewares are left alone.
    A second call changes nothing. `middleware` is the identifier of the RMW implementation.
    """
    discovery = environment.setdefault(RANGE, LOCALHOST)
    if discovery not in FILES or not middleware.startswith(FAST_DDS):
        return
    if any(environment.get(name) for name in CHOICES) or environment.get(LOCALHOST_ONLY) == '1':
        return
    if discovery == LOCALHOST:
        if environment.get(PEERS):
            return
        environment[RANGE] = BY_PROFILE
    environment[PROFILES] = str(share.path('node_runtime', 'config', FILES[discovery]))
