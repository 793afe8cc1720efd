from .blocks import Blocks as Blocks
