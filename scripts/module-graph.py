#!/usr/bin/env python3
"""Finds circles among the modules of each crate.

In every folder the modules, each with all that is below it, must import each other one way. A module and the folder that
it stands in may know each other: a folder's `mod.rs` is the face of its files. Tests do not count.

usage: scripts/module-graph.py [--show CRATE]   prints a crate's imports between top-level modules
"""

import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path


def crates():
    """Every source folder of the workspace, by its crate's name."""
    manifests = subprocess.run(["git", "ls-files", "*Cargo.toml"], capture_output=True, text=True, check=True)
    for manifest in manifests.stdout.split():
        source = Path(manifest).parent / "src"
        name = re.search(r'^name = "(.*?)"', Path(manifest).read_text(), re.M)
        if name and source.is_dir():
            yield name.group(1), source


def modules(source):
    """Each module by its path, as a tuple of names; the crate's root is the empty one."""
    found = {}
    for path in sorted(source.rglob("*.rs")):
        parts = path.relative_to(source).with_suffix("").parts
        if parts in (("lib",), ("main",)):
            parts = ()
        elif parts[-1] == "mod":
            parts = parts[:-1]
        if "tests" not in parts and not any(part.startswith("test_") for part in parts):
            found.setdefault(parts, []).append(path)
    return found


def without_tests_and_comments(text):
    text = re.sub(r"//.*", "", text)
    kept, position = [], 0
    for match in re.finditer(r"#\[cfg\(test\)\]\s*(?:pub(?:\(\w+\))? )?mod \w+ \{", text):
        if match.start() < position:
            continue
        kept.append(text[position : match.start()])
        depth, position = 1, match.end()
        while depth and position < len(text):
            depth += {"{": 1, "}": -1}.get(text[position], 0)
            position += 1
    kept.append(text[position:])
    return "".join(kept)


def expanded(text):
    """Every path that the text names from `crate`, `super` or `self` on, those in braces one by one."""
    for match in re.finditer(r"\b(?:crate|super|self)(?:::\w+)*(?:::(\{))?", text):
        head = match.group(0)
        if not match.group(1):
            yield head.split("::")
            continue
        depth, start = 1, match.end()
        end = start
        while depth and end < len(text):
            depth += {"{": 1, "}": -1}.get(text[end], 0)
            end += 1
        prefix = head[: -len("::{")].split("::")
        yield from (prefix + rest for rest in in_braces(text[start : end - 1]))


def in_braces(text):
    """The paths of a list in braces, which may have lists in braces."""
    depth, item, items = 0, "", []
    for letter in text:
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            items.append(item)
            item = ""
        else:
            item += letter
    items.append(item)
    for item in items:
        head, brace, rest = item.strip().partition("{")
        names = [name for name in re.split(r"::|\s+as\s+\w+", head.strip()) if name]
        if brace:
            yield from (names + path for path in in_braces(rest.rsplit("}", 1)[0]))
        elif names:
            yield names


def imports(module, text, known):
    """The modules that a module names."""
    for path in expanded(text):
        if path[0] == "crate":
            at = ()
        else:
            at = module
        rest = path[1:] if path[0] in ("crate", "self") else path
        while rest and rest[0] == "super":
            at, rest = at[:-1], rest[1:]
        while rest and at + (rest[0],) in known:
            at, rest = at + (rest[0],), rest[1:]
        if at in known and at != module:
            yield at


def graph(source):
    """For each module the modules that it names, with the file that does."""
    known = modules(source)
    found = defaultdict(set)
    for module, paths in known.items():
        for path in paths:
            for named in imports(module, without_tests_and_comments(path.read_text()), known):
                found[module].add(named)
    return known, found


def between_siblings(known, found):
    """Edges between the modules of one folder, each with all that is below it: folder, from, to, by which file."""
    for module, named in found.items():
        for other in named:
            depth = 0
            while depth < min(len(module), len(other)) and module[depth] == other[depth]:
                depth += 1
            if depth < len(module) and depth < len(other):
                yield module[:depth], module[depth], other[depth], (module, other)


def circles(edges):
    """Groups of names that reach each other."""
    reach = defaultdict(set)
    for start in list(edges):
        stack = [start]
        while stack:
            for name in edges.get(stack.pop(), ()):
                if name not in reach[start]:
                    reach[start].add(name)
                    stack.append(name)
    groups = {frozenset({name} | {o for o in reach[name] if name in reach.get(o, ())}) for name in reach}
    return [group for group in groups if len(group) > 1]


def main():
    wrong = 0
    for name, source in crates():
        known, found = graph(source)
        folders = defaultdict(lambda: defaultdict(set))
        reasons = defaultdict(set)
        for folder, one, other, reason in between_siblings(known, found):
            folders[folder][one].add(other)
            reasons[folder, one, other].add(reason)
        if sys.argv[1:] == ["--show", name]:
            for one, others in sorted(folders[()].items()):
                print(f"{one} -> {' '.join(sorted(others))}")
        for folder, edges in folders.items():
            for group in circles(edges):
                wrong += 1
                place = "::".join((name, *folder))
                print(f"{place}: {len(group)} modules import each other in a circle: {', '.join(sorted(group))}")
                for (at, one, other), why in sorted(reasons.items()):
                    if at == folder and one in group and other in group:
                        shown = ", ".join(sorted("::".join(a) + " -> " + "::".join(b) for a, b in why)[:3])
                        print(f"    {one} -> {other}   ({shown})")
    if wrong:
        sys.exit(1)
    print("no circles among the modules of any folder")


main()
