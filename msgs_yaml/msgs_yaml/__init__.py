"""The contract between the nodes: topics, the values they carry, and conversion to messages.

Contract
    contract       topics.yaml: type, rate, frame, QoS, fields with unit and range of every topic
    conformance    check messages against the contract, as objects and as arrays
    field_paths    field paths such as `poses[*].pose.position.x`
Values and messages
    types          the values of every topic as named tuples
    decode         message -> value, checked
    encode         value -> message
    flat_fields    values of fixed size: as flat numbers, and to and from serialised messages, fast
    raw_scenario   serialised path and road edges -> value, fast
    point_cloud    the points of predictions, packed
    conversions    time stamps, headings, diagnostic values
Files
    strict_yaml    YAML as typed values of a schema; errors name file, line and key
    missing_file   what is there in place of a file that is not
    share          data files and programs of the packages
"""
