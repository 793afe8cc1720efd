from .bag import (
    WrittenBag as WrittenBag,
    export_bag as export_bag,
)
