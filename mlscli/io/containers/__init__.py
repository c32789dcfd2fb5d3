"""Containers of messages: ROS 1 bags, ROS 2 bags and MCAP files, whole or damaged."""
