from .layout_file import (
    Viewer as Viewer,
    WrittenLayout as WrittenLayout,
    write_layout as write_layout,
)
