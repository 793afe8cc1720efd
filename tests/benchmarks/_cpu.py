"""CPU time of a benchmark and of what it has started."""

from __future__ import annotations

import resource

import psutil


def cpu_s() -> float:
    """CPU seconds of this process and its children so far, those that have ended among them."""
    ended = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    spent = sum(u.ru_utime + u.ru_stime for u in map(resource.getrusage, ended))
    living = [p.cpu_times() for p in psutil.Process().children(recursive=True)]
    return spent + sum(t.user + t.system + t.children_user + t.children_system for t in living)
