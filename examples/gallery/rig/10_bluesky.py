"""
Presses from Bluesky
====================

You get the documents of a Bluesky plan that presses twice on the virtual bench: one event for each reading, with the
times and numbers of the rig's journal. The script needs ``pip install 'indentation-rig[bluesky]'``.

How-to: :doc:`/streams`. Reference: :doc:`/data`.
"""

from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
from bluesky import RunEngine

from rig.bluesky import BlueskyBench, indent
from rig.data import read_run

FORCES_GWT = (1.0, 2.0)
events = []
engine = RunEngine({}, context_managers=[])
engine.subscribe(lambda name, document: events.append(document["data"]), "event")
with TemporaryDirectory() as folder:
    with BlueskyBench(indentor="bar:3.0", force_gwt=max(FORCES_GWT), presses=2, virtual=True, out=folder) as rig:
        for force_gwt in FORCES_GWT:
            engine(indent(rig, force_gwt=force_gwt))
    journal = read_run(rig.folder.path)
holds = [one for one in events if "rig_hold_end_force_gwt" in one]
samples = [one for one in events if "rig_sample_force_gwt" in one]
print("held:", *(f"{one['rig_hold_end_force_gwt']:.2f} gwt" for one in holds))

figure, axes = plt.subplots(layout="constrained")
axes.plot([one["t_s"] for one in journal.stream("sample")], [one["force_gwt"] for one in journal.stream("sample")])
axes.plot([one["rig_sample_t_s"] for one in samples], [one["rig_sample_force_gwt"] for one in samples], ".")
axes.set(xlabel="time of the run (s)", ylabel="force (gwt)")
axes.legend(["journal", "events of Bluesky"])
plt.show()
