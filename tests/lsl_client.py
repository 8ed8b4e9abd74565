"""A program that receives both streams of `rig stream` over loopback until a run stops; prints them as JSON."""

import json
import sys

import pylsl

NAMES = ("rig_samples", "rig_markers")


def main() -> None:
    """Print a line once both inlets are open, and one with all that they received up to the marker `stop`."""
    inlets = {}
    for name in NAMES:
        (found,) = pylsl.resolve_byprop("name", name, 1, 60.0)
        inlets[name] = pylsl.StreamInlet(found, max_buflen=3600, recover=False)
        inlets[name].open_stream(60.0)
    channels = inlets[NAMES[0]].info(60.0).desc().child("channels").child("channel")
    labels = []
    while not channels.empty():
        labels.append([channels.child_value("label"), channels.child_value("unit")])
        channels = channels.next_sibling("channel")
    print(json.dumps({"channels": labels}), flush=True)
    received: dict[str, list[tuple[float, list[object]]]] = {name: [] for name in NAMES}
    for name in reversed(
        NAMES
    ):  # the readings that precede the last marker are sent before it, on another connection
        while True:
            values, times = inlets[name].pull_chunk(timeout=1.0, max_samples=4096)
            received[name] += zip(times, values, strict=True)
            ended = [row for row in received["rig_markers"] if json.loads(str(row[1][0]))["marker"] == "stop"]
            if ended and not times:
                break
    print(json.dumps(received), flush=True)


if __name__ == "__main__":
    sys.exit(main())
