"""One section of the skin: a second-order Fourier curve in the angle φ.

x = a cos φ + s ((1 + sin φ)/2)²,  y = b (½(1 + r) sin φ + ½(1 − r) sin² φ)
with half-width a, height b and lean s in mm, and r the depth of the nail side over the height.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def shape(phi: ArrayLike, ratio: float) -> tuple[Array, Array, Array]:
    """What half-width, height and lean are multiplied by at angle φ."""
    s = np.sin(phi)
    return np.cos(phi), 0.5 * (1 + ratio) * s + 0.5 * (1 - ratio) * s * s, (0.5 * (1 + s)) ** 2


def position(phi: ArrayLike, parameters: Array, ratio: float) -> tuple[Array, Array]:
    """x and y in mm of sections with (3, …) half-widths, heights and leans in mm (broadcast)."""
    a, b, lean = parameters
    across, up, sideways = shape(phi, ratio)
    return a * across + lean * sideways, b * up


def first_derivative(phi: ArrayLike, parameters: Array, ratio: float) -> tuple[Array, Array]:
    """dx/dφ and dy/dφ in mm/rad."""
    a, b, lean = parameters
    s, c = np.sin(phi), np.cos(phi)
    return -a * s + 0.5 * lean * (1 + s) * c, b * c * (0.5 * (1 + ratio) + (1 - ratio) * s)


def second_derivative(phi: ArrayLike, parameters: Array, ratio: float) -> tuple[Array, Array]:
    """d²x/dφ² and d²y/dφ² in mm/rad²."""
    a, b, lean = parameters
    s, c = np.sin(phi), np.cos(phi)
    return (
        -a * c + 0.5 * lean * (c * c - s * (1 + s)),
        b * ((1 - ratio) * (c * c - s * s) - 0.5 * (1 + ratio) * s),
    )


def normal(phi: ArrayLike, parameters: Array, ratio: float) -> Array:
    """(…, 2) outward unit normal within the plane of the section."""
    d_x, d_y = first_derivative(phi, parameters, ratio)
    return np.stack([d_y, -d_x], -1) / np.hypot(d_x, d_y)[..., None]


def nearest_angle(x: Array, y: Array, parameters: Array, ratio: float) -> Array:
    """(n,) angles of the points closest to (n,) x and y in mm, each on its own section."""
    a, b, lean = parameters
    phi = np.arctan2(y / b, (x - lean) / a)
    for _ in range(50):
        at_x, at_y = position(phi, parameters, ratio)
        d_x, d_y = first_derivative(phi, parameters, ratio)
        dd_x, dd_y = second_derivative(phi, parameters, ratio)
        speed2 = d_x**2 + d_y**2
        bend = np.maximum(speed2 + (at_x - x) * dd_x + (at_y - y) * dd_y, 0.5 * speed2)  # convex, however far off
        step = ((at_x - x) * d_x + (at_y - y) * d_y) / bend
        phi = phi - step
        if np.abs(step).max() < 1e-13:
            break
    return np.asarray(phi)
