"""Entry point of the command: what must be so before any module loads.

Output is UTF-8 wherever it goes: a pipe or a file of Windows has a code page without Greek
letters. From the first line on an interruption gives no traceback (`cosim.cli.interruptions`).

A short command spends its time on loading, so that three habits of Python are changed: linear
algebra has one thread, since its matrices are small and starting threads costs a third of loading
NumPy; what is loaded is looked through for garbage less often, and not once more at the end.
"""

import _signal  # type: ignore[import-not-found]  # the interpreter's own: it imports nothing

# what is imported next gets no exception of a signal, which callbacks of imports drop; nothing is
# imported before, __future__ neither
_handler = _signal.getsignal(_signal.SIGINT)
_ends = _handler is _signal.default_int_handler
try:
    if _ends:
        _signal.signal(_signal.SIGINT, _signal.SIG_DFL)
except ValueError:  # another thread than the main one gets no signals
    _ends = False
try:
    import gc
    import io
    import os
    import sys

    from cosim.cli.interruptions import interruptions
finally:
    if _ends:
        _signal.signal(_signal.SIGINT, _handler)

_OBJECTS_BETWEEN_COLLECTIONS = 50_000


def main() -> None:
    """Load the command line and run it."""
    interruptions.take()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # not where a test or a notebook captures it
            stream.reconfigure(encoding="utf-8", errors="backslashreplace")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(_OBJECTS_BETWEEN_COLLECTIONS)
    from cosim.cli.application import main as run  # noqa: PLC0415 - the signals are taken before

    try:
        run()
    finally:
        gc.freeze()
