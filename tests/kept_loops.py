"""The machine code of the contact's loops, for a copy of `sim`: to compile it anew takes half a minute."""

import shutil
from hashlib import sha1
from pathlib import Path

from platformdirs import user_cache_path

SIM = Path("sim")
ROOMS = (SIM / "contact", SIM / "contact" / "compiled", SIM / "coding", SIM / "fem", SIM / "nerve")
ROOT = Path(__file__).parents[1]


def bring_loops(folder: Path) -> None:
    """Bring it to the copy under a folder, whose sources are the same to the byte.

    numba keeps it by the folder of the source, and looks at the source's time.
    """
    for room in ROOMS:
        name = f"{room.name}_{sha1(str(folder / room).encode()).hexdigest()}"
        ours = f"loops-*/{room.name}_{sha1(str(ROOT / room).encode()).hexdigest()}"
        for found in user_cache_path("indentation-rig").glob(ours):
            shutil.copytree(found, found.with_name(name), dirs_exist_ok=True)
        for source in (ROOT / room).glob("*.py"):
            shutil.copystat(source, folder / room / source.name)
