"""Errors against closed forms and another program, as the tables of docs/validation/oracles.md.

    .venv/bin/python -m studies.accuracy.oracles    # about three minutes

The problems and their sources are in studies/verification; the tests in tests/sim/oracles bound a part of these
numbers.
"""

import time
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from sim.fem.elements import Element
from studies.verification import contrast, halfspace, layer, line_contact, membrane, round_contact
from studies.verification.contact import contact_errors

ELEMENTS: tuple[Element, ...] = ("bbar", "full")


def first(row: Iterable[object]) -> str:
    """What rows are sorted by."""
    return str(next(iter(row)))


def table(title: str, columns: str, rows: Iterable[Iterable[object]]) -> None:
    """Print a Markdown table; columns are parted by |."""
    print(f"\n### {title}\n\n| {columns} |\n|{'---|' * (columns.count('|') + 1)}")
    for row in rows:
        print("| " + " | ".join(str(cell) for cell in row) + " |", flush=True)


def percent(value: float) -> str:
    """A ratio as a percentage with two significant digits or two decimals."""
    return f"{100 * value:+.2f} %"


def cook() -> None:
    """Cook's membrane."""
    reference = membrane.tip_deflection_taylor_hood(32)
    rows = ((n, *(percent(membrane.tip_deflection(n, e) / reference - 1) for e in ELEMENTS)) for n in (8, 16, 32, 64))
    table(f"Cook's membrane, ν = 0.4999: reference {reference:.4f} mm", "elements a side | B-bar | full", rows)


def interior() -> None:
    """Flamant and Boussinesq."""
    rows = [
        (f"line, {h:g} mm", *(percent(halfspace.largest_error(*halfspace.line_load(h, 80.0, e))) for e in ELEMENTS))
        for h in (0.17, 0.085, 0.0425, 0.02125)
    ]
    rows += [
        (f"point, {h:g} mm", *(percent(halfspace.largest_error(*halfspace.point_load(h, 10.0, e))) for e in ELEMENTS))
        for h in (0.17, 0.1, 0.085)
    ]
    table(
        "Strain 0.765 mm under a load on one node, largest error over largest strain",
        "load, mesh | B-bar | full",
        rows,
    )
    exact = halfspace.line_load(0.02125, 10.0)[1]
    strain = {size: halfspace.line_load(0.02125, size)[0] for size in (10.0, 20.0, 40.0, 80.0)}
    pairs = [
        (
            f"{a:g} and {b:g} mm",
            *(percent(halfspace.largest_error(strain[s], exact)) for s in (a, b)),
            percent(halfspace.largest_error(2 * strain[b] - strain[a], exact)),
        )
        for a, b in pairwise(strain)
    ]
    table("Truncation of the line load's box, mesh 0.02 mm", "boxes | smaller | larger | extrapolated", pairs)


def layers() -> None:
    """Transfer functions."""
    sixteen = (layer.Layer(1.0, 1.0, 16),)
    rows = []
    for k in (0.5, 2.0, 5.0, 10.0):
        errors = (
            percent(layer.compliance(k, sixteen, nu, 1 / 16, e) / layer.one_layer_compliance(k, sixteen[0], nu) - 1)
            for nu in (0.48, 0.4999)
            for e in ELEMENTS
        )
        rows.append((f"{k:g}", f"{32 * np.pi / k:.0f}", *errors))
    columns = "kH | elements a wavelength | B-bar, ν 0.48 | full | B-bar, ν 0.4999 | full"
    table("One layer of 16 elements on a rigid base, surface compliance", columns, rows)
    rows = []
    for wavelength in (0.7, 1.4, 2.8, 5.6, 11.2):
        k = 2 * np.pi / wavelength
        exact = layer.layers_compliance(k, layer.TISSUE, halfspace.POISSON)
        meshes: tuple[tuple[int, float, Element], ...]
        meshes = ((2, 0.17, "bbar"), (4, 0.085, "bbar"), (8, 0.0425, "bbar"), (2, 0.17, "full"))
        errors = (
            percent(
                layer.compliance(k, tuple(c.refined(n) for c in layer.TISSUE), halfspace.POISSON, h, e) / exact - 1
            )
            for n, h, e in meshes
        )
        rows.append((f"{wavelength:g}", *errors))
    columns = "wavelength, mm | B-bar 0.17 mm, two in the epidermis | 0.085 mm | 0.0425 mm | full 0.17 mm"
    table("Epidermis on dermis on bone, surface compliance", columns, rows)


def smooth_lines() -> None:
    """Hertz, wedge, Westergaard."""
    rows = []
    for n in (4, 8, 16, 32, 64):
        patch, cell = line_contact.half_space(n, 40), line_contact.wave_cell(n)
        problems = (
            ("cylinder", patch, line_contact.cylinder()),
            ("wedge", patch, line_contact.wedge()),
            ("wave, half closed", cell, line_contact.wave(1.0)),
            ("wave, 85 % closed", cell, line_contact.wave(1.5)),
        )
        for name, on, exact in problems:
            errors = contact_errors(on, exact)
            rows.append((name, n, percent(errors.half_width), percent(errors.spread), percent(errors.inside)))
    columns = "shape | elements a mm | half-width | spread of pressure | pressure inside"
    table("Line contact at given force, half-width 1 mm (wave: 1 and 1.5 mm)", columns, sorted(rows, key=first))


def flat_punch() -> None:
    """Singular: orders of convergence."""
    meshes = (8, 16, 32, 64, 128)
    patches = [line_contact.half_space(n, 20) for n in meshes]
    states = [line_contact.punched(p) for p in patches]
    force = np.array([s.normal_force for s in states])
    edge = np.array([line_contact.punch_edge_pressure(p, s) for p, s in zip(patches, states, strict=True)])
    inside = [line_contact.punch_errors(p, s).inside for p, s in zip(patches, states, strict=True)]
    limit = 2 * force[-1] - force[-2]
    order = ["–", *(f"{np.log2((force[i] - limit) / (force[i + 1] - limit)):.2f}" for i in range(3)), "–"]
    growth = ["–", *(f"{v:.3f}" for v in np.log2(edge[1:] / edge[:-1]))]
    rows = zip(meshes, map(percent, force / limit - 1), order, growth, map(percent, inside), strict=True)
    columns = "elements a half-width | force | order (1) | exponent of edge pressure (½) | pressure to 0.8 a"
    table("Flat punch in plane strain, force against its extrapolation", columns, rows)


def truncation() -> None:
    """Line contact in boxes of growing size."""
    sizes = (5, 10, 20, 40, 80)
    errors = [contact_errors(line_contact.half_space(16, s), line_contact.cylinder()).spread for s in sizes]
    extrapolated = ["–", *(percent(b + (b - a) / 3) for a, b in pairwise(errors))]
    rows = zip(sizes, map(percent, errors), extrapolated, strict=True)
    table(
        "Truncation: cylinder at given force, 16 elements",
        "box over half-width | spread | extrapolated, order 2",
        rows,
    )


def round_shapes() -> None:
    """Sphere, cone and flat punch in three dimensions."""
    rows = []
    shapes = {"sphere": round_contact.sphere(), "cone": round_contact.cone(), "flat punch": round_contact.flat()}
    for n in (4, 8, 16):
        small, large = (round_contact.quarter_space(n, size) for size in (10, 20))
        for name, shape in shapes.items():
            doi = [round_contact.doi_error(patch, shape) for patch in (small, large)]
            doi.append(round_contact.extrapolated(*doi))
            errors = contact_errors(large, shape)
            radius = "–" if name == "flat punch" else percent(errors.half_width)
            rows.append((name, n, radius, *map(percent, (errors.spread, errors.inside, *doi))))
    columns = "shape | elements a radius | radius | spread | pressure inside | DOI, box 10 a | 20 a | extrapolated"
    table("Round contact at given force, radius 1 mm", columns, sorted(rows, key=first))


def incompressible() -> None:
    """Towards ν = ½."""
    rows = []
    for nu in (0.48, 0.49, 0.499, 0.4999):
        cylinder = line_contact.cylinder(nu)
        found = [contact_errors(line_contact.half_space(16, 40, nu, e), cylinder) for e in ELEMENTS]
        strain = [halfspace.largest_error(*halfspace.line_load(0.085, 40.0, e, nu)) for e in ELEMENTS]
        cells = (percent(v) for f, s in zip(found, strain, strict=True) for v in (f.spread, f.inside, s))
        rows.append((f"{nu:g}", *cells))
    columns = "ν | B-bar: spread | pressure | strain | full: spread | pressure | strain"
    table("Nearly incompressible: cylinder (16 elements) and line load (0.085 mm)", columns, rows)


def unlike_layers() -> None:
    """Condensation of stiff bone and of stiff skin."""
    rows = []
    for ratio in (1e3, 1e4, 1e6, 1e8):
        bone, skin = contrast.condensed(ratio, "bone"), contrast.condensed(ratio, "skin")
        values = (bone.imbalance, bone.mismatch, skin.imbalance, skin.mismatch)
        rows.append((f"{ratio:.0e}", *(f"{v:.0e}" for v in values)))
    columns = "ratio | bone below: imbalance | mismatch | skin above: imbalance | mismatch"
    table("Unlike layers: condensed forces put back", columns, rows)


def flat_elements() -> None:
    """Aspect ratios."""
    rows = []
    for aspect in (1, 4, 10, 20, 50):
        k = 2 * np.pi / (40 * aspect / 16)
        squeezed = layer.Layer(1.0, 1.0, 16)
        cells = [
            layer.compliance(k, (squeezed,), nu, aspect / 16) / layer.one_layer_compliance(k, squeezed, nu) - 1
            for nu in (0.48, 0.4999)
        ]
        k = 2 * np.pi / (40 * 0.2 * aspect)
        skin = (layer.Layer(0.4, 100.0, 2), layer.Layer(4.0, 1.0, 40))
        cells.append(layer.compliance(k, skin, 0.48, 0.2 * aspect) / layer.layers_compliance(k, skin, 0.48) - 1)
        rows.append((aspect, *map(percent, cells)))
    columns = "length over height | layer, ν 0.48 | layer, ν 0.4999 | bending skin"
    table("Flat elements, 40 a wavelength", columns, rows)


def main() -> None:
    """All tables."""
    start = time.perf_counter()
    for part in (
        cook,
        interior,
        layers,
        smooth_lines,
        flat_punch,
        truncation,
        round_shapes,
        incompressible,
        unlike_layers,
        flat_elements,
    ):
        part()
    print(f"\n{time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
