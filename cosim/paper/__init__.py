"""The paper, claim by claim: what is printed, what comes out, and why they differ."""

from cosim.paper.report import Report, reproduce
from cosim.paper.row import How, Row, Verdict

__all__ = ["How", "Report", "Row", "Verdict", "reproduce"]
