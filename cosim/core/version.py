"""The version of this distribution."""

import importlib.metadata

__version__ = importlib.metadata.version("auv-cosim")
"""Version of the distribution auv-cosim that is installed."""
