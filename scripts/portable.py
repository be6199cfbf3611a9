#!/usr/bin/env python3
"""Finds what would keep the bench without real mode from being built on another system than Linux.

Reads from standard input what Cargo says of a build (`--message-format json`), and from Cargo's dep-info which sources of this
repository went into it, and looks in them for what only Linux or Unix has. Items under a `cfg` that names the system, and tests, do
not count.

usage: cargo check -p bench --no-default-features --message-format json | scripts/portable.py
"""

import json
import re
import sys
from pathlib import Path

NOT_PORTABLE = re.compile(r"std::os::(?:unix|linux|fd)\b|signal::unix|\brustix::|\blibc::|\bprotocol_linux\b")
CONDITION = re.compile(r"#\[cfg\((?:test|unix|target_os = \"linux\"|all\([^\]]*target_os = \"linux\"\))\)\]\s*")


def listings(messages):
    """The dep-info of each library and program that was built: `NAME-HASH.d` beside `libNAME-HASH.rmeta`."""
    for message in map(json.loads, messages):
        if message["reason"] == "compiler-artifact":
            for built in map(Path, message["filenames"]):
                listing = built.with_name(built.stem.removeprefix("lib") + ".d")
                if listing.is_file():
                    yield listing


def sources(messages):
    """The sources of this repository that the build read, without generated and vendored ones."""
    root = Path.cwd()
    for listing in listings(messages):
        for line in listing.read_text().splitlines():
            path = Path(line.removesuffix(":"))
            if line.endswith(".rs:") and not path.is_absolute() and (root / path).is_file():
                yield path


def without_comments(text):
    return re.sub(r"//.*", "", text)


def without_conditional_items(text):
    """The text without items that are there on Linux or in tests only: to the end of their braces, or to `;` or `,`."""
    kept, position = [], 0
    while match := CONDITION.search(text, position):
        kept.append(text[position : match.start()])
        depth, end = 0, match.end()
        while end < len(text):
            letter = text[end]
            depth += {"{": 1, "(": 1, "[": 1, "}": -1, ")": -1, "]": -1}.get(letter, 0)
            end += 1
            if depth < 0 or depth == 0 and letter in "};,":
                break
        position = end
    kept.append(text[position:])
    return "".join(kept)


def main():
    found = sorted(set(sources(sys.stdin)))
    if len(found) < 100:
        sys.exit(f"only {len(found)} sources of the build are known: does Cargo write its messages as JSON?")
    wrong = 0
    for path in found:
        text = without_conditional_items(without_comments(path.read_text()))
        for name in sorted({match.group(0) for match in NOT_PORTABLE.finditer(text)}):
            wrong += 1
            print(f"{path} names {name}, which other systems lack", file=sys.stderr)
    if wrong:
        sys.exit(1)
    print(f"{len(found)} sources of the bench without real mode name nothing that only Linux has")


main()
