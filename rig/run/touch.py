"""Contact found from force readings near the threshold."""

from collections.abc import Sequence

import numpy as np

from rig.run.records import Touch

CONTACT_EXPONENT = 1.5  # F ∝ d^1.5, a sphere pressed on an elastic solid (Hertz)


def fit_contact(readings: Sequence[tuple[float, float]], threshold_gwt: float, resolution_gwt: float) -> Touch:
    """Contact height from (height mm, force gwt) readings that descend to the threshold.

    What is less than half a step of the sensor, resolution_gwt, counts as no force.

    F^(2/3) is linear in the height; its weighted least-squares line is followed back to zero. The answer lies
    above the first reading with force by no more than the step to it and what the line needs to reach the noise (at
    most the descent it was fitted over); it is that reading's height where fewer than two show any.
    """
    noise_gwt = 0.5 * resolution_gwt
    height, force = np.array(readings).T
    shown = force > noise_gwt
    first = int(np.argmax(shown))
    before = height[first - 1] if first else height[first]
    contact = highest = height[first]
    if shown.sum() >= 2:
        root = force[shown] ** (1 / CONTACT_EXPONENT)
        slope, intercept = np.polyfit(height[shown], root, 1, w=force[shown] ** (1 - 1 / CONTACT_EXPONENT))
        if slope < 0:
            contact = -intercept / slope
            unseen = noise_gwt ** (1 / CONTACT_EXPONENT) / -slope
            highest = before + min(unseen, height[first] - height[-1])
    contact = float(np.clip(contact, height[first], highest))
    return Touch(threshold_gwt, float(height[-1]), float(force[-1]), contact, int(shown.sum()))
