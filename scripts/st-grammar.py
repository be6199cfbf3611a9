"""Parses files of Structured Text by the grammar of tree-sitter-iec61131-3-st, which others wrote.

Prints each place that it cannot parse; exit code 1 if there is one. It checks the syntax only: types and names are our checker's work.
"""

import sys

import tree_sitter
import tree_sitter_iec61131_3_st


def faults(node):
    """Yields the nodes that are errors or missing."""
    if node.type == "ERROR" or node.is_missing:
        yield node
        return
    for child in node.children:
        yield from faults(child)


def main():
    """Parses the files that are named."""
    parser = tree_sitter.Parser(tree_sitter.Language(tree_sitter_iec61131_3_st.language()))
    found = 0
    for name in sys.argv[1:]:
        with open(name, "rb") as file:
            tree = parser.parse(file.read())
        for node in faults(tree.root_node):
            found += 1
            row, column = node.start_point
            print(f"{name}:{row + 1}:{column + 1}: {node.type}", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
