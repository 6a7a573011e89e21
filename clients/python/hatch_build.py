"""Adds the programs and what they ship with to the wheel, where `deploy/packages.sh` has laid them out.

DREAMSTREAM_PREFIX is a folder with `bin/` and `share/dreamstream/`, DREAMSTREAM_PLATFORM the wheel's platform tag; without
them the wheel holds the Python client alone.
"""

import os
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CustomBuildHook(BuildHookInterface):
    def initialize(self, version, build_data):
        prefix = os.environ.get("DREAMSTREAM_PREFIX")
        if prefix is None or version == "editable":
            return
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{os.environ['DREAMSTREAM_PLATFORM']}"
        for program in Path(prefix, "bin").iterdir():
            build_data["shared_scripts"][str(program)] = program.name
        build_data["shared_data"][str(Path(prefix, "share"))] = "share"
