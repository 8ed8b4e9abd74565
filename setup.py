"""Puts files of the source tree that the program reads into its packages."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

SHIPPED = {
    "protocols": "rig/shipped_protocols",
    "examples/human_finger": "rig/shipped_fingers/human_finger",
    "studies/results/devices/measured.csv": "rig/devices/measured.csv",
}
"""Place in the source tree, and in the wheel. An editable install reads them where they are."""


class BuildWithShippedFiles(build_py):
    """The packages and `SHIPPED`."""

    def run(self) -> None:
        """Copy all files."""
        super().run()
        if not self.editable_mode:
            for source, inside in SHIPPED.items():
                target = Path(self.build_lib) / inside
                target.parent.mkdir(parents=True, exist_ok=True)
                if Path(source).is_dir():
                    shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True)
                else:
                    shutil.copyfile(source, target)


setup(cmdclass={"build_py": BuildWithShippedFiles})
