"""What the workers of the tests do."""

from __future__ import annotations

import ctypes
import os
import signal
import socket
import struct
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cosim.core import Frames


def obey(
    end: socket.socket, descriptors: Sequence[int], *arguments: Any, known: Sequence[Any] = ()
) -> None:
    """Do what the messages say, and answer each, until there is nobody to listen."""
    frames = Frames(end, list[Any])
    while True:
        try:
            what, *more = frames.receive()
        except EOFError:
            return
        frames.send(_done(what, more, end, descriptors, arguments, known))


def _done(  # noqa: C901, PLR0911, PLR0912 - one case for each word
    what: str,
    more: list[Any],
    end: socket.socket,
    descriptors: Sequence[int],
    arguments: tuple[Any, ...],
    known: Sequence[Any],
) -> Any:
    match what:
        case "tell":
            return [list(arguments), len(known), len(descriptors), os.getpid(), os.getppid()]
        case "die":
            os.kill(os.getpid(), more[0])
        case "leave":
            os._exit(more[0])
        case "print":
            sys.stdout.write(f"{more[0]}\n")
        case "modules":
            return [name for name in more if name in sys.modules]
        case "environment":
            return [os.getcwd(), os.environ.get("COSIM_TEST")]  # noqa: PTH109 - as it is
        case "descriptors":
            found = [(name, _name_of(int(name))) for name in os.listdir("/proc/self/fd")]  # noqa: PTH208 - numbers
            return [one for one in found if one[1] not in (None, os.devnull)]
        case "daemon":
            return [_daemon()]
        case "trace":
            ctypes.CDLL(None).ptrace(0, 0, None, None)
        case "raw":
            end.sendall(more[0])
        case "announce":
            end.sendall(struct.pack("<I", more[0]))
        case "silence":
            os.close(end.fileno())
            time.sleep(60)
        case "ignore":
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                signal.signal(number, signal.SIG_IGN)
            time.sleep(60)
        case "write":
            os.pwrite(descriptors[0], more[0], 0)
        case "shrink":
            try:
                os.ftruncate(descriptors[0], 0)
            except OSError as error:
                return [error.strerror]
    return []


def _name_of(number: int) -> str | None:
    try:
        return str(Path(f"/proc/self/fd/{number}").readlink())
    except OSError:
        return None


def _daemon() -> int:
    """Start a process that leaves session, group and parent; return its number."""
    read, write = os.pipe()
    if os.fork() == 0:
        os.setsid()
        number = os.fork()
        if number == 0:
            time.sleep(120)
            os._exit(0)
        os.write(write, struct.pack("<q", number))
        os._exit(0)
    (number,) = struct.unpack("<q", os.read(read, 8))
    os.close(read)
    os.close(write)
    return int(number)
