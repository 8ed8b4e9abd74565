"""The result of an identification, as a finger file."""

from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rig.identify.adaptive_presses import Identification
from rig.plan.config import Config
from rig.plan.finger_file import Band, Draw, FingerFile, IdentifiedFinger, Place, Posterior
from rig_shared.user_files import sha256_of
from sim.identification.prior import Prior, series_of, tissue_of
from sim.identification.uncertainty_bands import COVERAGE, parameter_ends

Array = NDArray[np.float64]

_DRAWS = 16
_DIGITS = 6


def finger_file(identification: Identification, config: Config, journals: Sequence[Path]) -> FingerFile:
    """Return the finger file of an identification with at least one press."""
    learned, prior = identification.learned, identification.predicted.prior
    sd = np.sqrt(learned.covariance.diagonal())
    low, high = parameter_ends(learned.draws)
    x, height = prior.index("x_mm"), prior.index("height_mm")
    most_likely = _draw(prior, learned.most_likely)
    zeros = [measured.zero_gwt for measured in identification.measured]
    tissue = config.finger.tissue.model_copy(update=most_likely.tissue)
    identified = IdentifiedFinger(
        date=datetime.now(UTC).isoformat(timespec="seconds"),
        version=version("indentation-rig"),
        bench=f"{config.stage.kind} and {config.force.kind}",
        runs=tuple(path.parent.name for path in journals),
        journals_sha256=tuple(sha256_of(path) for path in journals),
        presses=len(identification.measured),
        collapsed=learned.collapsed,
        flagged=identification.mismatch,
        not_learned=tuple(identification.not_learned),
        place=Place(
            x_mm=_fine(learned.mean[x]),
            x_sd_mm=_fine(sd[x]),
            height_mm=_fine(learned.mean[height]),
            height_sd_mm=_fine(sd[height]),
            cell_zero_gwt=_fine(float(np.mean(zeros))),
            cell_zero_sd_gwt=_fine(float(np.std(zeros))),
        ),
        posterior=Posterior(
            names=prior.names,
            mean=tuple(_fine(v) for v in learned.mean),
            covariance=tuple(tuple(float(f"{v:.6g}") for v in row) for row in learned.covariance),
            low=tuple(_fine(v) for v in low),
            high=tuple(_fine(v) for v in high),
        ),
        draw=tuple(_draw(prior, one) for one in _spread(learned.draws)),
        band=Band(model_error=_fine(identification.own_error), coverage=COVERAGE),
    )
    return FingerFile(
        finger=config.finger.model_copy(update={"tissue": tissue}),
        relaxation=most_likely.relaxation,
        identified=identified,
    ).sealed()


def _spread(draws: Array) -> list[Array]:
    """Return 16 draws, spaced evenly along their first principal component."""
    spread = draws.std(axis=0)
    off = (draws - draws.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    along = np.argsort(off @ np.linalg.svd(off, full_matrices=False)[2][0])
    return [draws[along[int((k + 0.5) * len(draws) / _DRAWS)]] for k in range(_DRAWS)]


def _draw(prior: Prior, values: Array) -> Draw:
    by_name = dict(zip(prior.names, values.tolist(), strict=True))
    tissue = {name: _fine(value) for name, value in tissue_of(by_name).items()}
    relaxation = tuple((_fine(share), _fine(tau_s)) for share, tau_s in series_of(by_name))
    return Draw.model_validate({**tissue, "relaxation": relaxation})


def _fine(value: float) -> float:
    return round(float(value), _DIGITS)
