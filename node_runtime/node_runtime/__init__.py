"""What every node needs, whatever vehicle or controller: parameters, topics, clocks, life cycle.

Parameters
    parameters          typed parameters with range and unit; parameter files and their `base`
    node_parameters     parameters of a node: file, overrides, what every node declares
    parameter_docs      every parameter as text: type, unit, range, default, meaning
    named_vector        nested named tuples as flat vectors
    scheduling          real-time priority, core, locked memory
Topics
    ros                 publishers, subscriptions and QoS from the contract
    subscriptions_node  bounded decoding, polled subscriptions, publisher monitor
    input_monitor       age of an input against its limit, as a diagnostic level
    transport           UDP within this machine, unless the user chose another transport
Life cycle
    managed_node        configure, activate, deactivate, clean up: the life cycle of ROS 2
    spin_node           run a node from its command line to its exit code
    shutdown            signals, exit in bounded time
    clocks              wall time that does not jump
    log_filters         filters against repeated log lines
    provenance          versions, machine and commit for the metadata of a bag
"""
