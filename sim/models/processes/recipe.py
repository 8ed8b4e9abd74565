"""How a finger crosses processes: by what it was made from, never by its matrices."""

from collections.abc import Callable, Hashable
from copy import copy
from functools import lru_cache
from typing import Any, NamedTuple, Self

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


class ByRecipe:
    """Copies share everything that is costly, and a pickle holds the recipe and the stiffness scale only."""

    recipe: Recipe
    e_epidermis_mpa: float

    def __copy__(self) -> Self:
        copied = object.__new__(type(self))
        copied.__dict__.update(self.__dict__)
        return copied

    def __deepcopy__(self, _: dict[int, object]) -> Self:
        return copy(self)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Recipe, float]]:
        return _anew, (self.recipe, self.e_epidermis_mpa)


def _anew(recipe: Recipe, e_epidermis_mpa: float) -> Any:
    finger = copy(made(recipe))
    finger.e_epidermis_mpa = e_epidermis_mpa
    return finger
