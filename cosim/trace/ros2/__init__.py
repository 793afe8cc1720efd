"""A trace as a bag of ROS 2: MCAP with messages in CDR and schemas as ros2msg."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
