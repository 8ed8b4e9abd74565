"""Runs against the model: responses at the receptors, figures and the report."""

from rig.compare.report import write_report
from rig.compare.responses import Response, responses

__all__ = ["Response", "responses", "write_report"]
