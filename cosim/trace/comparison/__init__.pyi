from .comparison_picture import draw_diff as draw_diff
from .format import (
    diff_json as diff_json,
    diff_verdict as diff_verdict,
    differences as differences,
    further_differences as further_differences,
)
from .tolerance import Tolerance as Tolerance
