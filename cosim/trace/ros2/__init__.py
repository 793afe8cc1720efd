"""A trace as a bag of ROS 2: MCAP with messages in CDR and schemas as ros2msg."""

from cosim.trace.ros2.bag import WrittenBag, export_bag

__all__ = ["WrittenBag", "export_bag"]
