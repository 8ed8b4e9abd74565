"""Text of the protocol script of a design, and its check: plan and rehearsal before it is written."""

import textwrap
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rig.design.presses import PossiblePress

_HEAD = '''"""{title}

{about}
"""

from rig.design.adaptive_run import Chooser, CountsSource
from rig.protocol import Field, ProtocolParameters, Rig

METADATA = {{
    "title": "Designed presses",
    "source": {source},
}}

# What the presses were chosen for; with counts=SOURCE, the run chooses again after each count.
{design}

# Shape, then x (mm) and {target} of its presses, in order.
BLOCKS = (
'''

_TAIL = '''

class Parameters(ProtocolParameters):
    """Parameters that `--set` can change."""

    hold_s: float = Field({hold_s:g}, ge=0, le=60, description="hold of each press, in s: the window of the counts")
    rest_s: float = Field({rest_s:g}, ge=0, le=3600, description="rest after each press, in s: the washout")
    counts: CountsSource = Field("", description="COUNTS.csv, lsl:STREAM, virtual:SA1: counts that choose presses")
    count_within_s: float = Field(30, gt=0, le=3600, description="longest wait for a count, in s; then BLOCKS follow")


def run(rig: Rig) -> None:
    """Mount the shape of each press, zero, and press with a rest after it."""
    p = rig.parameters
    with Chooser(
        rig, DESIGN, BLOCKS, hold_s=p.hold_s, rest_s=p.rest_s, counts=p.counts, within_s=p.count_within_s
    ) as chooser:
        mounted, mounts = "", 0
        while press := chooser.next():
            if press.shape != mounted:
                mounted, mounts = press.shape, mounts + 1
                rig.mount(mounted)
                if mounts == 1:
                    rig.home()
                rig.checkpoint(f"indentor {{mounts}}: {{mounted}}")
                rig.zero()
            rig.move_to(x_mm=press.x_mm)
            rig.indent({kind}=press.target, hold_s=p.hold_s)
            rig.rest(p.rest_s)
'''

_WIDTH = 116


def script_text(
    blocks: Sequence[NDArray[np.int64]],
    presses: Sequence[PossiblePress],
    about: str,
    command: str,
    hold_s: float,
    rest_s: float,
    design: str,
) -> str:
    """Return the script of presses in blocks, each of one shape; `design` is its block DESIGN."""
    kind = presses[0].kind
    target = {"doi_mm": "depth (mm)", "force_gwt": "force (gwt)"}[kind]
    head = _HEAD.format(
        title="Presses chosen to distinguish candidate measures; written by `rig design`.",
        about=textwrap.fill(about, _WIDTH),
        source=literal(command),
        target=target,
        design=design,
    )
    lines = []
    for block in blocks:
        pairs = ", ".join(f"({presses[k].x_mm:g}, {presses[k].target:g})" for k in block)
        wrapped = textwrap.wrap(pairs + ",", _WIDTH - 8, break_long_words=False)
        wrapped = _whole_pairs(wrapped)
        lines += [f"    ({literal(presses[block[0]].shape)}, ("]
        lines += [f"        {line}" for line in wrapped]
        lines += ["    )),"]
    return head + "\n".join(lines) + "\n)\n" + _TAIL.format(kind=kind, hold_s=hold_s, rest_s=rest_s)


def _whole_pairs(lines: Sequence[str]) -> list[str]:
    """Return the lines, none of which breaks between the two numbers of a press."""
    found: list[str] = []
    rest = ""
    for line in lines:
        line = f"{rest} {line}".strip()
        rest = ""
        if line.rfind("(") > line.rfind(")"):
            at = line.rfind("(")
            line, rest = line[:at].rstrip(), line[at:]
        found.append(line)
    return [line for line in (*found, rest) if line]


def literal(text: str) -> str:
    """Return a Python literal in double quotes."""
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'
