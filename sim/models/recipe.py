"""How a finger crosses processes: by what it was made from, never by its matrices."""

from collections.abc import Callable, Hashable
from functools import lru_cache
from typing import Any, NamedTuple

_KEPT = 2


class Recipe(NamedTuple):
    """A call that makes the finger: an importable function, its arguments, and those that go by name."""

    make: Callable[..., Any]
    arguments: tuple[Hashable, ...]
    options: tuple[tuple[str, Hashable], ...]

    @classmethod
    def of(cls, make: Callable[..., Any], *arguments: Hashable, **options: Hashable) -> "Recipe":
        """The recipe that calls it so."""
        return cls(make, arguments, tuple(options.items()))


@lru_cache(maxsize=_KEPT)
def made(recipe: Recipe) -> Any:
    """What a recipe makes, kept: a process to which a finger is sent with each task reads its models once."""
    return recipe.make(*recipe.arguments, **dict(recipe.options))
