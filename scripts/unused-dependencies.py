#!/usr/bin/env python3
"""Fails where a crate of the workspace depends on a crate that none of its sources names."""

import pathlib
import re
import subprocess
import sys
import tomllib

SECTIONS = ("dependencies", "dev-dependencies", "build-dependencies")


def sources(folder, others):
    """The text of a crate's sources, without those of crates within its folder."""
    files = [*folder.rglob("*.rs"), *folder.glob("*.md")]
    own = (file for file in files if not any(other in file.parents for other in others))
    return "\n".join(file.read_text(encoding="utf-8") for file in own)


def dependencies(manifest):
    """The names by which a manifest's crate can use others, with their sections."""
    for table in (manifest, *manifest.get("target", {}).values()):
        for section in SECTIONS:
            for name in table.get(section, {}):
                yield name, section


def main():
    listed = subprocess.run(["git", "ls-files", "*Cargo.toml"], capture_output=True, text=True, check=True)
    folders = [pathlib.Path(line).parent for line in listed.stdout.splitlines()]
    unused = []
    for folder in folders:
        manifest = tomllib.loads((folder / "Cargo.toml").read_text(encoding="utf-8"))
        if "package" not in manifest:
            continue
        within = [other for other in folders if folder in other.parents]
        text = sources(folder, [pathlib.Path("target"), *within])
        for name, section in dependencies(manifest):
            if not re.search(rf"\b{name.replace('-', '_')}\b", text):
                unused.append(f"{folder}/Cargo.toml: `{name}` of [{section}] is used nowhere in the crate: remove it")
    sys.exit("\n".join(unused) or None)


main()
