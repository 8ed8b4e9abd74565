"""Words of the pages, explained once."""

GLOSSARY = {
    "afferent": "Nerve fiber that carries impulses from receptors in the skin: SA-I, RA and PC fibers.",
    "contact region": "Interval of x in which skin and indentor touch, on the undeformed skin in the receptor plane.",
    "DOI": "Depth of indentation (mm): how far the indentor has moved beyond first contact.",
    "dry run": "Execution of a protocol on virtual devices and a simulated finger; nothing moves.",
    "e11, e22, e33, e12, e23, e13": "Strain across the finger (x), along the normal of the pulp (y), along the "
    "finger (z), and the shear strains between these directions.",
    "ep1": "Smallest principal strain: the largest compression in any direction. It is plotted as −ep1, so that more "
    "compression is higher.",
    "ep3": "Largest principal strain: the largest extension in any direction.",
    "gwt": "Gram-weight, a unit of force: the weight of one gram. 1 gwt = 9.80665 mN.",
    "hold": "Part of a press after its depth or force is reached; forces and depths are means over it.",
    "indentor": "Body that presses the skin, such as bar:3.0 (a bar, 3 mm wide) or step:1 (step number 1).",
    "predicted": "Calculated by the finger model before the run, from the commanded depth or force.",
    "pseudo-units": "Stress or energy density relative to a stiffness of the epidermis of 10 000; the source states "
    "only ratios of stiffness.",
    "receptor plane": "Section across the finger in which the simulated receptors lie.",
    "SED": "Strain energy density: energy stored per volume by changes of shape and size. It is never negative.",
    "SSRP": "Simulated spatial response profile: the response at one receptor against the position of the indentor.",
    "touch-off": "Slow descent that finds the height of first contact, from which depths are counted.",
    "trip": "Force at which the program stops the stage at once.",
    "virtual": "Simulated: devices, finger or spikes that are calculated and not recorded.",
    "x, y, z": "Position across the finger, out of the pulp, and along the finger (mm).",
}
"""Word and meaning, in alphabetical order."""
