"""Parses the blocks of a PLCopen XML file for CODESYS by the grammar of blark, which others wrote.

Prints each block that it cannot parse; exit code 1 if there is one. It checks the syntax only: types and names are our checker's work.
Blocks are parsed by a process for each processor, since the grammar takes some seconds for a hundred lines.
"""

import multiprocessing
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
    """Returns a text with at most twenty values in a line of data: the grammar's time grows faster than their number."""
    lines = text.splitlines()
    of_data = [number for number, line in enumerate(lines) if line.startswith("        ") and line.strip(" ,0123456789") == ""]
    return "\n".join(line for number, line in enumerate(lines) if number not in of_data)


def fault(block):
    """Returns what the grammar says against a block, or None."""
    from blark.parse import parse_source_code

    file, name, text = block
    for result in [parse_source_code(shortened(text))]:
        if result.exception is not None:
            return f"{file}: {name}: {str(result.exception).splitlines()[0]}"
    return None


def main():
    """Parses the files that are named."""
    found = [(file, name, text) for file in sys.argv[1:] for name, text in blocks(file)]
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
