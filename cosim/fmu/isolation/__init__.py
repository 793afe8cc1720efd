"""Isolated slaves: each in a process of its own, served over shared memory and a pipe.

    process = SlaveProcess("plant", description)   # starts it
    slave = FmuSlave(description, "plant", log, process=process)

Get, set and step in the loop go over memory that both processes map (`channel.c`): the slave gives
addresses of proxies with the signatures of FMI, and the address of the channel as its component, so
that who calls by address calls isolated slaves as all others. Everything else goes over a pipe as
messages. Either process sleeps while it waits. The process ends with the one that started it,
however that ends; when it ends by itself, the call in progress says how.
"""

from cosim.fmu.isolation.process import SlaveProcess

__all__ = ["SlaveProcess"]
