"""Run folders: created before a run, read and exported after it."""

from typing import TYPE_CHECKING

from rig import door

if TYPE_CHECKING:
    from rig.data.export import NwbMissingError, export_nwb, export_run
    from rig.data.folder import FolderBusyError, RunFolder, new_run_folder
    from rig.data.run import Run, RunError, read_run

__all__ = [
    "FolderBusyError",
    "NwbMissingError",
    "Run",
    "RunError",
    "RunFolder",
    "export_nwb",
    "export_run",
    "new_run_folder",
    "read_run",
]

__getattr__ = door(
    __name__,
    {
        "rig.data.export": (
            "NwbMissingError",
            "export_nwb",
            "export_run",
        ),
        "rig.data.folder": (
            "FolderBusyError",
            "RunFolder",
            "new_run_folder",
        ),
        "rig.data.run": (
            "Run",
            "RunError",
            "read_run",
        ),
    },
)
