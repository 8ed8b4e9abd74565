"""Which cases of a study are on interpolated fingers, and what has to be built for these."""

from collections.abc import Sequence
from dataclasses import replace

from rig.parameter_study.cases import Case
from sim.contact.indentor import ALONG
from sim.contact.shapes import parse_shape
from sim.models.moduli.families import missing_nodes, worth_interpolating
from sim.models.moduli.node_builds import Node


def interpolated(cases: Sequence[Case]) -> list[Case]:
    """The same cases, those interpolated where fingers differ in the moduli of dermis and fat alone."""
    chosen = worth_interpolating([case.finger for case in cases])
    return [replace(case, exact=not one) for case, one in zip(cases, chosen, strict=True)]


def nodes_to_build(cases: Sequence[Case]) -> list[Node]:
    """Full builds that interpolated cases need and that are not on disk: pieces of work for `make_node`."""
    them = [case for case in cases if not case.exact]
    axes = dict.fromkeys([ALONG, *(parse_shape(case.shape).axes for case in them)])
    return missing_nodes([case.finger for case in them], axes)
