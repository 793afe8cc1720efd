"""Begin the deliveries of all packet links of a run; those over a medium share it."""

from __future__ import annotations

from collections.abc import Iterable

from cosim.core import InputError
from cosim.network.compiled_delivery import CompiledDelivery
from cosim.network.delivery import Delivery
from cosim.network.medium_delivery import MediumDelivery
from cosim.network.medium_traffic import MediumTraffic
from cosim.network.packet import PacketLink


def begin_deliveries(
    links: Iterable[PacketLink],
    end_ns: int,
    step_ns: int | None = None,
    compiled: CompiledDelivery | None = None,
) -> dict[str, Delivery]:
    """Return the deliveries of the packet links of a run, by name.

    `end_ns`, `step_ns`, `compiled` : as of `Delivery`.

    Raises
    ------
    InputError : as `Delivery`; links over a medium that do not go together.
    """
    begun: dict[str, Delivery] = {}
    media: dict[str, list[MediumDelivery]] = {}
    for link in links:
        if link.hop is None:
            begun[link.name] = Delivery(link, end_ns, step_ns, compiled)
            continue
        begun[link.name] = one = MediumDelivery(link, link.hop, end_ns, step_ns)
        others = media.setdefault(link.hop.medium.name, [])
        others.append(one)
        first = others[0].link
        if first.adjustable != link.adjustable:
            raise InputError(
                "the links over a medium are adjustable together",
                where=f"link {link.name!r}: adjustable",
                expected=f"{first.adjustable}, as of link {first.name!r}",
                got=repr(link.adjustable),
            )
        if first.hop is not None and first.hop.medium != link.hop.medium:
            raise InputError(
                "two media have one name",
                where=f"link {link.name!r}: hop",
                expected=f"the medium of link {first.name!r}",
                got=repr(link.hop.medium),
            )
    for over in media.values():
        hop = over[0].link.hop
        assert hop is not None  # noqa: S101 - links over a medium have one
        MediumTraffic(hop.medium, over, int(end_ns))
    return begun


def deliver(link: PacketLink, end_ns: int, step_ns: int | None = None) -> Delivery:
    """Return the delivery of all messages of a link of known delay, up to the end of a run.

    Raises
    ------
    InputError : as `Delivery`, or a delay that follows a signal of the run.
    """
    whole = Delivery(link, end_ns, step_ns)
    if whole.is_live:
        raise InputError(
            "the delay follows a signal, which is known only during the run",
            where=f"link {link.name!r}: delay",
            expected="a constant delay or a DelayProfile",
            got=repr(link.delay),
            hint="use Delivery, and pass it the value of each message as it is sent",
        )
    whole.advance(end_ns)
    return whole
