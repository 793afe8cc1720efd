from .own_library import (
    compiled_library as compiled_library,
    is_prebuilt as is_prebuilt,
    library_source as library_source,
    write_library as write_library,
)
from .prebuilt import (
    is_current as is_current,
    prebuilt_file as prebuilt_file,
    prebuilt_folder as prebuilt_folder,
    write_manifest as write_manifest,
)
