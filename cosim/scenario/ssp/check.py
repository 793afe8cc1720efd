"""Check which tools take an SSP archive, without having them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from cosim.scenario.ssp.archive import Archive
from cosim.scenario.ssp.tool_facts import ArchiveFacts
from cosim.scenario.ssp.tool_rules import RULES, SSP_TOOLS, Effect, SspTool


@dataclass(frozen=True)
class ToolFinding:
    """Something in an archive that a tool refuses or does differently.

    Attributes
    ----------
    code : the name of the rule.
    effect : "refused": the tool does not load the archive; "different": it runs another system.
    where : entry and line.
    got : what is there.
    reason, cure : why, and what to do.
    """

    tool: SspTool
    code: str
    effect: Effect
    where: str
    got: str
    reason: str
    cure: str


@dataclass(frozen=True)
class SspCheck:
    """What other tools make of an archive.

    Attributes
    ----------
    tools : that were asked for.
    findings : in the order of the tools and of their rules.
    notes : deviations from the standard.
    """

    path: Path
    tools: tuple[SspTool, ...]
    findings: tuple[ToolFinding, ...]
    notes: tuple[str, ...]

    def takes(self, tool: SspTool) -> bool:
        """Whether no rule says that the tool refuses the archive."""
        return not any(f.tool == tool and f.effect == "refused" for f in self.findings)

    def to_json(self) -> dict[str, object]:
        """Return what `cosim ssp check --json` prints."""
        return {
            "ssp": str(self.path),
            "tools": {tool: self.takes(tool) for tool in self.tools},
            "findings": [asdict(finding) for finding in self.findings],
            "notes": list(self.notes),
        }


def check_ssp(ssp: Path, tools: Sequence[SspTool] = SSP_TOOLS) -> SspCheck:
    """Say what tools would refuse in an archive, or run differently.

    Raises
    ------
    InputError : not an SSP archive, or a description that cannot be read.
    """
    with Archive(ssp) as archive:
        facts = ArchiveFacts(archive)
        found = {rule: list(rule.find(facts)) for rule in RULES}
        findings = [
            ToolFinding(
                tool=tool,
                code=rule.code,
                effect=rule.effects[tool],
                where=facts.place(element),
                got=got,
                reason=rule.reason,
                cure=rule.cure,
            )
            for tool in tools
            for rule, elements in found.items()
            if tool in rule.effects
            for element, got in elements
        ]
        return SspCheck(ssp, tuple(tools), tuple(findings), tuple(archive.notes))
