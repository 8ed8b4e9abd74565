"""A simulator: a finite-element fingertip, and virtual devices that answer the bytes of real ones.

From the bottom up, each room using only those above it in this list:

- `config`: what a fingertip is made from, measured skin, units.
- `fem`: elements, assembly, condensation. `contact`: rigid shapes on a condensed skin. `devices`: virtual
  instruments and their clock; `devices/grbl` is the board.
- `finger`: the skin's geometry and its mesh.
- `measures`: receptors under the skin, strain at them, the 18 measures.
- `models`: a finger, a section of it, a half-space, all indented the same way; `models/catalogue.py` is the door.
- `plant`: what stands under the virtual devices.
- `serve`: the same in real time, behind ports.
- `speed_and_error`: what each model costs and how wrong it is.
"""
