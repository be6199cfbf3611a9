"""Parses the blocks of a PLCopen XML file for CODESYS by the grammar of blark, which others wrote.

Prints each block that it cannot parse; exit code 1 if there is one. It checks the syntax only: types and names are our checker's work.
Blocks are parsed by a process for each processor, since the grammar takes some seconds for a hundred lines.
"""

import argparse
import multiprocessing
import re
import sys
import xml.etree.ElementTree as ElementTree

PLCOPEN = "{http://www.plcopen.org/xml/tc6_0200}"
XHTML = "{http://www.w3.org/1999/xhtml}"
ENDS = {"function": "END_FUNCTION", "functionBlock": "END_FUNCTION_BLOCK", "program": "END_PROGRAM"}


def blocks(file):
    """Yields name and text of each declaration of a file."""
    root = ElementTree.parse(file).getroot()
    for of_type in root.iter(PLCOPEN + "dataType"):
        yield of_type.get("name"), next(of_type.iter(XHTML + "xhtml")).text
    for block in root.iter(PLCOPEN + "pou"):
        interface, body = [text.text or "" for text in block.iter(XHTML + "xhtml")]
        yield block.get("name"), f"{interface}\n{body}\n{ENDS[block.get('pouType')]}\n"
    for variables in root.iter(PLCOPEN + "globalVars"):
        yield variables.get("name"), next(variables.iter(XHTML + "xhtml")).text


def shortened(text):
    """Returns a text without the lines that are nothing but values of data: the grammar's time grows with their number."""
    return "\n".join(line for line in text.splitlines() if line.strip(" ,0123456789") or not line.strip())


def fault(block):
    """Returns what the grammar says against a block, or None."""
    from blark.parse import parse_source_code

    file, name, text = block
    result = parse_source_code(shortened(text))
    if result.exception is None:
        return None
    return f"{file}: {name}: {str(result.exception).splitlines()[0]}"


def main():
    """Parses the files that are named, or one block of them with a mistake in it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+")
    parser.add_argument("--only", metavar="NAME", help="the only block to parse")
    parser.add_argument("--replace", metavar="PATTERN|BY", help="the mistake: the first match of a pattern, and what replaces it")
    options = parser.parse_args()
    found = [(file, name, text) for file in options.files for name, text in blocks(file)]
    if options.only:
        found = [block for block in found if block[1] == options.only]
    if options.replace:
        pattern, by = options.replace.split("|")
        wrong = [(file, name, re.sub(pattern, by, text, count=1, flags=re.MULTILINE)) for file, name, text in found]
        if wrong == found:
            print(f"{options.replace} changed nothing")
            return 0
        found = wrong
    # The longest first, so that no processor waits for one at the end.
    found.sort(key=lambda block: -len(block[2]))
    with multiprocessing.Pool() as pool:
        faults = [text for text in pool.imap_unordered(fault, found) if text]
    for text in faults:
        print(text, file=sys.stderr)
    print(f"{len(found)} declarations, {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
