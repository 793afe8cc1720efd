from .ball_matrices import (
    balls as balls,
    below as below,
    floats as floats,
    size as size,
)
from .contour import (
    Contour as Contour,
    NotCountedError as NotCountedError,
)
from .rational import (
    MAX_DIGITS as MAX_DIGITS,
    asymmetric as asymmetric,
    ball_precision as ball_precision,
    exact as exact,
    exact_matrix as exact_matrix,
    exact_symmetric as exact_symmetric,
    first_bad_matrix as first_bad_matrix,
    first_bad_pivot as first_bad_pivot,
    from_text as from_text,
    identity as identity,
    lower_triangle as lower_triangle,
    matrix_from_text as matrix_from_text,
    matrix_to_text as matrix_to_text,
    norm_is_below as norm_is_below,
    root_above as root_above,
    rounded_up as rounded_up,
    to_text as to_text,
)
