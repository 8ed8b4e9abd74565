"""The documentation as a site: `make docs` writes it to build/site. Commands, columns and names are generated."""

import os
import re
import sys
from importlib.metadata import version as installed
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from studies_page import provenance, studies_page  # noqa: E402

project = "Indentation rig"
os.environ["DASK_LOGGING__DISTRIBUTED"] = "error"  # the script of a cluster prints no page of workers that end
copyright = "The indentation rig authors, MIT licence"
version = release = installed("indentation-rig")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx_gallery.gen_gallery"]
exclude_patterns = ["figures/*.html"]
sphinx_gallery_conf = {
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "gallery",
    # Every script is run but the one that takes longer than all others: its page shows the stored figure.
    "filename_pattern": r"/(?!09_recorded_bar)\w+\.py",
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_signature": False,
    "write_computation_times": False,
}
html_theme = "furo"
html_title = f"Indentation rig {version}"
html_theme_options = {"source_repository": "", "navigation_with_keys": True}
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
suppress_warnings = ["misc.highlighting_failure"]  # mermaid, and blocks that are named by what becomes of them
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"  # fields are attributes already
autodoc_member_order = "bysource"

_PAGE = re.compile(r"`docs/([\w/]+)\.md`")


def _linked(app: Any, page: str, source: list[str]) -> None:
    """Turn paths of pages into links, and name the study above each of its tables."""
    up = "../" * page.count("/")
    source[0] = _PAGE.sub(lambda found: f"[`docs/{found[1]}.md`]({up}{found[1]}.md)", provenance(source[0], up))


def _generated(app: Any) -> None:
    """What is read off the program itself."""
    from columns_page import columns_page
    from commands_page import commands_page
    from interface_page import device_interface_page, settings_page
    from json_page import json_page, write_schemas
    from names_page import names_page

    (HERE / "columns.md").write_text(columns_page(), encoding="utf-8")
    (HERE / "commands.md").write_text(commands_page(), encoding="utf-8")
    (HERE / "device_interface.md").write_text(device_interface_page(), encoding="utf-8")
    (HERE / "json_output.md").write_text(json_page(), encoding="utf-8")
    write_schemas(HERE / "json_schemas")
    (HERE / "settings.md").write_text(settings_page(), encoding="utf-8")
    (HERE / "python_names.md").write_text(names_page(), encoding="utf-8")
    (HERE / "studies.md").write_text(studies_page(), encoding="utf-8")


def setup(app: Any) -> None:
    """As Sphinx asks for it."""
    app.connect("builder-inited", _generated)
    app.connect("source-read", _linked)
