#!/usr/bin/env python3
"""Counts, for each crate, phrases and first words to avoid and type names that stand more than once.

Fails where a count is above that of scripts/words.json, and shows the places; `--update` writes the counts of today.
CONTRIBUTING.md, Words, has the rule.
"""

import collections
import json
import pathlib
import re
import subprocess
import sys

COUNTS = pathlib.Path("scripts/words.json")
PHRASES = ("is no", "told", "behind", "as good as", "otherwise than", "of one that", "by itself", "given up")
PHRASE = re.compile(r"\b(" + "|".join(phrase.replace(" ", r"\s+") for phrase in PHRASES) + r")\b", re.IGNORECASE)
# Of a doc comment.
FIRST_WORD = re.compile(r"\s*//[/!] (Of|What|How|Whether|Than|By it)\b")
DOC_COMMENT = re.compile(r"\s*//[/!]")
TYPE = re.compile(r"\s*(?:pub(?:\([^)]*\))? )?(?:struct|enum|trait|union) ([A-Z]\w*)")
COMMON_TYPES = {"Error", "Event", "Config", "Cli", "Connection", "Identity"}
# A name is shared from this number of crates on.
SHARED = 3


def listed(*patterns):
    output = subprocess.run(["git", "ls-files", *patterns], capture_output=True, text=True, check=True).stdout
    return [pathlib.Path(line) for line in output.splitlines()]


def read(path):
    return path.read_text(encoding="utf-8", errors="replace").splitlines()


def places_and_types():
    """Where each phrase and first word stands, by crate; how often each type name does, by name and crate."""
    crates = {manifest.parent for manifest in listed("Cargo.toml", "*/Cargo.toml")}
    places = collections.defaultdict(lambda: collections.defaultdict(list))
    types = collections.defaultdict(collections.Counter)
    for path in listed("*.rs", "*.md"):
        crate = str(next(folder for folder in path.parents if folder in crates))
        crate = "pages" if path.suffix == ".md" else crate
        before = ""
        for number, line in enumerate(read(path), 1):
            found = [" ".join(phrase.lower().split()) for phrase in PHRASE.findall(line)]
            first = FIRST_WORD.match(line)
            if first and not DOC_COMMENT.match(before):
                found.append(f"begins with {first[1]}")
            for phrase in found:
                places[crate][phrase].append(f"{path}:{number}: {line.strip()}")
            if (name := TYPE.match(line)) and path.suffix == ".rs" and name[1] not in COMMON_TYPES:
                types[name[1]][crate] += 1
            before = line
    return places, types


def main():
    places, types = places_and_types()
    counts = {crate: {phrase: len(at) for phrase, at in sorted(of.items())} for crate, of in sorted(places.items())}
    shared = {name: len(crates) for name, crates in sorted(types.items()) if len(crates) >= SHARED}
    doubled = collections.Counter()
    for crates in types.values():
        doubled.update({crate: number - 1 for crate, number in crates.items() if number > 1})
    now = {"phrases": counts, "names in three or more crates": shared, "doubled names": dict(sorted(doubled.items()))}
    if "--update" in sys.argv[1:]:
        COUNTS.write_text(json.dumps(now, indent=2) + "\n", encoding="utf-8")
        return 0

    before = json.loads(COUNTS.read_text(encoding="utf-8"))
    risen = []
    for crate, of in counts.items():
        print(f"{crate}: " + ", ".join(f"{phrase} {number}" for phrase, number in of.items()))
        for phrase, number in of.items():
            allowed = before["phrases"].get(crate, {}).get(phrase, 0)
            if number > allowed:
                risen.append("\n  ".join([f"{crate}: {phrase}: {number}, at most {allowed}", *places[crate][phrase]]))
    print(f"{len(shared)} names in three or more crates: " + ", ".join(f"{n} {c}" for n, c in shared.items()))
    for part in ("names in three or more crates", "doubled names"):
        for name, number in now[part].items():
            allowed = before[part].get(name, 0)
            if number > allowed:
                risen.append(f"{part}: {name}: {number}, at most {allowed}")
    if risen:
        print("\n".join(["", "risen; write it in another way, or accept it with scripts/words.py --update:", *risen]))
    return 1 if risen else 0


if __name__ == "__main__":
    sys.exit(main())
