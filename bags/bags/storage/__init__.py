"""MCAP files in the rosbag2 layout: read, write, describe, repair.

read                  a bag in memory, its topics as columns and values
invalid_messages      drop the messages that break the contract
columns               stamps, values and columns of raw messages
bag_writer            write a bag, in one file or several
repair                rebuild a bag that was cut off or damaged
message_filing        the log time of a message, and how many were lost
mcap_reader, rosbag2_metadata, cdr   the formats
"""
