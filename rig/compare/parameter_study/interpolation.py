"""Which pieces of work are on interpolated fingers, and what has to be built for these."""

from collections.abc import Sequence
from dataclasses import Field, replace
from typing import Any, ClassVar, Protocol, TypeVar

from sim.contact.indentor import ALONG
from sim.contact.shapes import parse_shape
from sim.models.interpolation import Asked, Node, missing_nodes, worth_interpolating


class OnAFinger(Protocol):
    """Presses on one finger: a dataclass, with `exact` where the finger is built in full."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def exact(self) -> bool: ...

    @property
    def finger(self) -> Asked: ...

    @property
    def shapes(self) -> Sequence[str]: ...


Work = TypeVar("Work", bound=OnAFinger)


def interpolated(work: Sequence[Work]) -> list[Work]:
    """The same, those interpolated where fingers differ in the moduli of dermis and fat alone."""
    chosen = worth_interpolating([one.finger for one in work])
    return [replace(one, exact=not other) for one, other in zip(work, chosen, strict=True)]


def nodes_to_build(work: Sequence[OnAFinger]) -> list[Node]:
    """Full builds that interpolated fingers need and that are not on disk: pieces of work for `make_node`."""
    them = [one for one in work if not one.exact]
    axes = dict.fromkeys([ALONG, *(parse_shape(shape).axes for one in them for shape in one.shapes)])
    return missing_nodes([one.finger for one in them], axes)
