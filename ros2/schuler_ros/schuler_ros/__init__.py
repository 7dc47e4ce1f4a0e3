"""ROS 2 node of schuler's live navigation."""
