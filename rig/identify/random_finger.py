"""Random fingers of the prior for a virtual bench."""

import numpy as np

from rig.plan.config import Config
from sim.identification.prior import Prior, series_of, strain_of, tissue_of

CELL_NOISE_GWT = 0.02
MOST_DRIFT_GWT_PER_MIN = 0.1  # largest drift of the zero, in either direction


def truth_of(seed: int, prior: Prior | None = None) -> dict[str, float]:
    """Return the parameters of the random finger of a seed, by the names of the prior."""
    prior = prior or Prior()
    chance = np.random.default_rng([seed, 0x5712A9])
    return dict(zip(prior.names, prior.draws(1, chance)[0].tolist(), strict=True))


def with_random_finger(config: Config, seed: int) -> Config:
    """Return the configuration of a virtual bench with the random finger of a seed."""
    return with_parameters(config, truth_of(seed), seed)


def with_parameters(config: Config, truth: dict[str, float], seed: int = 0) -> Config:
    """Return the configuration of a virtual bench with a finger of these parameters."""
    strain = strain_of(truth["stiffening"])
    tissue = config.finger.tissue.model_copy(update={**tissue_of(truth), "strain": strain})
    drift = float(np.random.default_rng([seed, 0xD81F7]).uniform(-MOST_DRIFT_GWT_PER_MIN, MOST_DRIFT_GWT_PER_MIN))
    virtual = config.virtual.model_copy(
        update={
            "relaxation": series_of(truth),
            "finger_x_offset_mm": truth["x_mm"],
            "finger_z_offset_mm": truth["height_mm"],
            "cell_noise_gwt": CELL_NOISE_GWT,
            "cell_drift_gwt_per_min": drift,
            "noise_seed": seed,
        }
    )
    return config.model_copy(
        update={"finger": config.finger.model_copy(update={"tissue": tissue}), "virtual": virtual}
    )
