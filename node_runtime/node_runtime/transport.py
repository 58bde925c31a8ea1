"""The transport of a node: UDP, within this machine unless the user opens it. No ROS.

Shared memory, which Fast DDS prefers by default, does not always survive a process that is killed:
the next one takes over its port, and a process that still writes to the old port may remove the new
one under its reader (Fast DDS 2.14, `SharedMemGlobal::open_port_internal`). The new process then
hears some of the others, or none. `bench/restarts.py` counts how often. The kernel cleans up after
UDP, which takes as long for messages of the sizes of a drive (docs/performance.md).
"""

from collections.abc import MutableMapping
from pathlib import Path

from msgs_yaml import share

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
LOCALHOST, SUBNET, BY_PROFILE = 'LOCALHOST', 'SUBNET', 'SYSTEM_DEFAULT'
PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'
FILES = {LOCALHOST: 'fast_dds_localhost.xml', SUBNET: 'fast_dds_subnet.xml'}
FAST_DDS = 'rmw_fastrtps'  # begins the names of its middleware interfaces
# who sets one of these has chosen peers or a transport
CHOICES = (PROFILES, 'ROS_DISCOVERY_SERVER')
# Fast DDS loads this file of the working directory, too, and its last default profile applies
LOCAL_PROFILES = 'DEFAULT_FASTRTPS_PROFILES.xml'
# rmw_fastrtps ignores this in its own LOCALHOST; UDPv4 is what our profiles select
TRANSPORTS, UDP = 'FASTDDS_BUILTIN_TRANSPORTS', 'UDPv4'
# rmw_fastrtps applies these to a range that it sets up itself
PEERS, LOCALHOST_ONLY = 'ROS_STATIC_PEERS', 'ROS_LOCALHOST_ONLY'
VARIABLES = (RANGE, *CHOICES, TRANSPORTS, PEERS, LOCALHOST_ONLY)


def configure(environment: MutableMapping[str, str], middleware: str) -> None:
    """Choose range and transport in the environment of this process, before rclpy is initialised.

    Without ROS_AUTOMATIC_DISCOVERY_RANGE a node discovers this machine only. With Fast DDS, for
    LOCALHOST and SUBNET, a profile selects UDP. LOCALHOST then reads SYSTEM_DEFAULT, which leaves
    the range to the profile: rmw_fastrtps adds shared memory to its own LOCALHOST.

    The range and everything else stay as they are with another middleware, with another range, and
    where the user has chosen: by a file of profiles, a discovery server, built-in transports other
    than UDPv4, or ROS_LOCALHOST_ONLY=1; for LOCALHOST also by named hosts (ROS_STATIC_PEERS). A
    second call changes nothing. `middleware` is the identifier of the RMW implementation.
    """
    discovery = environment[RANGE] = environment.get(RANGE) or LOCALHOST
    is_chosen = (
        any(environment.get(name) for name in CHOICES)
        or (environment.get(TRANSPORTS) or UDP) != UDP
        or environment.get(LOCALHOST_ONLY) == '1'
        or Path(LOCAL_PROFILES).exists()
        or (discovery == LOCALHOST and environment.get(PEERS))
    )
    if discovery not in FILES or not middleware.startswith(FAST_DDS) or is_chosen:
        return
    if discovery == LOCALHOST:
        environment[RANGE] = BY_PROFILE
    environment[PROFILES] = str(share.path('node_runtime', 'config', FILES[discovery]))
