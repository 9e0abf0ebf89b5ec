"""What a wheel holds that the clone does not, or has elsewhere; the build runs this.

The translations are compiled, and the page whose examples `drop explain` shows goes with them. An
editable install reads that page where it is, and finds the translations compiled beside their
source; the tests compile them again once their source is newer.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).parent
SOURCES = "pipeline"
MESSAGES = "drop_physics/locale/ja/LC_MESSAGES/drop.po"
PAGES = {"docs/why.md": "drop_physics/rules/why.md"}


def compile_messages(source: Path, target: Path) -> None:
    """Write the translations in a `.po` file as `gettext` reads them."""
    with source.open("rb") as file:
        catalog = read_po(file)
    part = target.with_suffix(".mo.part")
    with part.open("wb") as file:
        write_mo(file, catalog)
    part.replace(target)


class WheelFiles(BuildHookInterface):
    """Adds files to a wheel, or for an editable install makes them in the clone."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the translations, and add what goes with them."""
        source = ROOT / SOURCES / MESSAGES
        if version == "editable":
            compile_messages(source, source.with_suffix(".mo"))
            return
        self._folder = tempfile.TemporaryDirectory()
        compiled = Path(self._folder.name, "drop.mo")
        compile_messages(source, compiled)
        target = Path(MESSAGES).with_suffix(".mo").as_posix()
        build_data["force_include"] |= {str(compiled): target}
        build_data["force_include"] |= {str(ROOT / page): to for page, to in PAGES.items()}

    def finalize(self, *_: object) -> None:
        """Remove what was compiled only to be added."""
        if hasattr(self, "_folder"):
            self._folder.cleanup()
