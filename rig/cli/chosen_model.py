"""Which model `rig indent` uses, and what it may say about force."""

from dataclasses import dataclass
from typing import Any, Literal, get_args

from rig.protocol.errors import BadInputError
from sim.benchmark import QUANTITIES
from sim.choice import Aim, Choice, choose
from sim.config import FingertipConfig, MeshSpec
from sim.contact.indentor import Indentor
from sim.measures.receptors import ReceptorPlaces
from sim.models.catalogue import MODELS, ModelName, load
from sim.models.fingertip import Fingertip
from sim.units import GWT_N

TOLERANCE, QUANTITY = "2%", "force"
"""What `auto` holds unless it is told."""

_LONGEST_MM = 50.0


@dataclass(frozen=True)
class Chosen:
    """A model by name or by choice, and the length behind a section's force."""

    model: ModelName
    choice: Choice | None
    length_mm: float | None

    @property
    def why(self) -> str:
        """In one line."""
        return f"{self.model}, as asked for" if self.choice is None else self.choice.why

    @property
    def receptors(self) -> bool:
        """Whether there are any."""
        return self.choice is None or self.choice.aim.receptors

    def load(self, config: FingertipConfig, slopes: tuple[int, ...], receptors: ReceptorPlaces) -> Fingertip:
        """The model of a configuration, made for shapes that slope along some axes, with receptors."""
        if self.choice is None:
            return load(self.model, config, slopes=slopes, **receptors.as_options())
        return self.choice.load(config, receptors)

    def force_per_mm(self, force_gwt: float | None) -> float | None:
        """The force to ask the model for: a section's is per millimetre."""
        if force_gwt is None or self.model != "section":
            return force_gwt
        if self.length_mm is None:
            raise BadInputError(
                "--model section: its force is per millimetre, expected {needs} beside {option}",
                code="needs_option", option="--force-gwt", needs="--length-mm",
            )  # fmt: skip
        return force_gwt / self.length_mm

    def force_text(self, force_n: float) -> str:
        """The force as it is printed."""
        if self.model != "section":
            return f"{force_n:.5f} N = {force_n / GWT_N:.4f} gwt"
        if self.length_mm is None:
            return f"{force_n:.5f} N/mm (--length-mm turns it into gwt)"
        whole = force_n * self.length_mm
        return f"{force_n:.5f} N/mm, over {self.length_mm:g} mm {whole:.5f} N = {whole / GWT_N:.4f} gwt"

    def described(self, answer: dict[str, Any]) -> dict[str, Any]:
        """The JSON of an indentation with how its model was chosen; a section's force is null without a length."""
        asked_for = {"level": None, "promised_error": None, "why": self.why}
        answer["choice"] = asked_for if self.choice is None else self.choice.as_json()
        if self.model == "section":
            answer["force_n_per_mm"], answer["effective_length_mm"] = answer["force_n"], self.length_mm
            for key in ("force_n", "force_gwt"):
                answer[key] = None if self.length_mm is None else answer[key] * self.length_mm
        return answer


@dataclass(frozen=True)
class Wanted:
    """What the command line asked for."""

    model: ModelName | None  # None: the cheapest that holds the aim
    aim: Aim
    length_mm: float | None

    @classmethod
    def parse(cls, model: str, tolerance: str | None, quantity: str | None, length_mm: float | None) -> "Wanted":
        """Raises BadInputError, saying what was expected."""
        if model not in (*MODELS, "auto"):
            raise BadInputError(
                "{option} {value!r}: expected one of {expected}, auto",
                code="unknown_choice", option="--model", value=model, expected=", ".join(get_args(ModelName)),
            )  # fmt: skip
        quantities = tuple((quantity or QUANTITY).split(","))
        if not set(quantities) <= set(QUANTITIES):
            raise BadInputError(
                "{option} {value!r}: expected one of {expected}, or several",
                code="unknown_choice", option="--quantity", value=quantity, expected=", ".join(QUANTITIES),
            )  # fmt: skip
        if length_mm is not None and not (model in ("section", "auto") and 0 < length_mm <= _LONGEST_MM):
            raise BadInputError(
                "{option} {value:g}: expected 0 … {high:g}, for --model section or auto",
                code="outside_range", option="--length-mm", value=length_mm, high=_LONGEST_MM,
            )  # fmt: skip
        aim = Aim(quantities, _fraction(tolerance or TOLERANCE), per_length=length_mm is not None)
        for option, given in (("--tol", tolerance), ("--quantity", quantity)):
            if given is not None and model != "auto":
                raise BadInputError(
                    "{option} {value}: expected {needs} beside it",
                    code="needs_option", option=option, value=given, needs="--model auto",
                )  # fmt: skip
        named = next((name for name in MODELS if name == model), None)
        return cls(named, aim, length_mm)

    def for_point(self) -> Chosen:
        """The named model; raises BadInputError where it takes no point load."""
        if self.model not in ("finger", "section"):
            raise BadInputError(
                "--shape point: expected --model finger or section", code="no_point_loads", model=self.model
            )
        return self._as_asked(self.model)

    def refuse(self, config: FingertipConfig, receptors: ReceptorPlaces) -> None:
        """What a choice cannot go by, before it is made."""
        if self.model is not None:
            return
        if config.mesh != MeshSpec():
            raise BadInputError(
                "--model auto: chooses the mesh itself, expected no [finger.mesh] in --config", code="mesh_configured"
            )
        if not self.aim.receptors and receptors != ReceptorPlaces():
            raise BadInputError(
                "--model auto: no receptors are made for force alone, expected --quantity sed or ep1",
                code="receptors_unmade",
            )

    def choose(
        self,
        indentor: Indentor,
        x_mm: float,
        z_mm: float | None,
        doi_mm: float | None,
        force_gwt: float | None,
        *,
        reference: Literal["contact", "apex"],
        config: FingertipConfig,
    ) -> Chosen:
        """The named model, or the cheapest known to hold; raises NoModelError where none is."""
        if self.model is not None:
            return self._as_asked(self.model)
        found = choose(
            indentor,
            x_mm,
            z_mm=z_mm,
            doi_mm=doi_mm,
            force_gwt=force_gwt,
            aim=self.aim,
            reference=reference,
            config=config,
        )
        return Chosen(found.model, found, self.length_mm)

    def _as_asked(self, model: ModelName) -> Chosen:
        return Chosen(model, None, self.length_mm)


def _fraction(text: str) -> float:
    try:
        value = float(text.removesuffix("%")) / (100 if text.endswith("%") else 1)
    except ValueError:
        value = -1.0
    if not 0 < value < 1:
        raise BadInputError(
            "{option} {value!r}: expected a part of the whole, as 2% or 0.02",
            code="bad_value", option="--tol", value=text,
        )  # fmt: skip
    return value
