#!/usr/bin/env python3
"""Adds up the lines that tests reach, from llvm-cov's summary on standard input, by crate."""

import json
import pathlib
import sys


def crate_of(path, root):
    """Returns the folder of the crate that a file belongs to."""
    for folder in path.parents:
        if folder == root:
            return None
        if (folder / "Cargo.toml").exists():
            return folder.relative_to(root)
    return None


def main():
    root = pathlib.Path(sys.argv[1]).resolve()
    counts = {}
    for file in json.load(sys.stdin)["data"][0]["files"]:
        path = pathlib.Path(file["filename"])
        crate = crate_of(path, root) if path.is_relative_to(root) else None
        if crate is not None:
            lines = file["summary"]["lines"]
            covered, count = counts.get(crate, (0, 0))
            counts[crate] = covered + lines["covered"], count + lines["count"]
    print("| crate | lines | reached |\n|---|---|---|")
    for crate, (covered, count) in sorted(counts.items(), key=lambda entry: str(entry[0])):
        print(f"| `{crate}` | {count:,} | {100 * covered / max(count, 1):.1f} % |")
    covered, count = (sum(column) for column in zip(*counts.values()))
    print(f"| all | {count:,} | {100 * covered / max(count, 1):.1f} % |")


main()
