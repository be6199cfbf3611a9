# shellcheck shell=bash
# Exported code by the grammars of others.

ST_GRAMMAR=tree-sitter-iec61131-3-st==0.1.2
TREE_SITTER=tree-sitter==0.26.1
BLARK=blark==0.8.3
RAPIDCHECKER=rapidchecker==0.1.5

verb_grammars() { #: parse exported Structured Text and RAPID by grammars that others wrote, and find mistakes by them
    local out python file mistake application
    python_tool st-grammar "$TREE_SITTER" "$ST_GRAMMAR"
    python=$TOOLS/python
    build
    out=$(mktemp -d)
    # shellcheck disable=SC2064 # the directory of now
    trap "rm -rf '$out'" EXIT
    for application in pick-and-place pick-and-place-gripper; do
        built plc-node export --for st --setup A --application "$application" --out "$out/$application"
    done
    "$python" scripts/st-grammar.py "$out"/*/skillbench.st
    file=$out/pick-and-place/skillbench.st
    # The grammar must find a mistake, or it proves nothing.
    for mistake in 'END_IF;|' ' := | = = ' ' THEN$|' '^END_FUNCTION_BLOCK|'; do
        sed "0,/${mistake%%|*}/s/${mistake%%|*}/$(cut -d'|' -f2 <<<"$mistake")/" "$file" >"$out/wrong.st"
        cmp --silent "$file" "$out/wrong.st" && { echo "$mistake changed nothing" >&2; return 1; }
        if "$python" scripts/st-grammar.py "$out/wrong.st" 2>/dev/null; then
            echo "the grammar accepts $mistake" >&2
            return 1
        fi
    done
    echo "exported Structured Text: no fault by the grammar of others, which finds 4 mistakes of 4"
    python_tool codesys-grammar "$BLARK"
    codesys_grammar "$TOOLS/python" "$out"
    python_tool rapid-grammar "$RAPIDCHECKER"
    rapid_grammar "$TOOLS/python" "$out"
}

# rapid_grammar PYTHON DIRECTORY: the same for RAPID, by rapidchecker.
rapid_grammar() {
    local python=$1 out=$2 file mistake application found=0
    for application in pick-and-place pick-and-place-gripper; do
        built robot-node export --for abb --setup B --application "$application" --out "$out/rapid-$application"
    done
    # The grammar does not know the error handler of a TRAP, which the manual has.
    sed --null-data --in-place 's/  ERROR\n    RAISE;\n  ENDTRAP/  ENDTRAP/' "$out"/rapid-*/SB_Motion.mod
    "$python" -m rapidchecker "$out"/rapid-*/*.mod "$out"/rapid-*/*.sys
    for file in SB_Motion.mod SB_Cyclic.mod SB_Shared.sys; do
        for mistake in 'ENDIF|' ':=|:= :=' ';$|' '^  ENDFUNC|' '^ENDMODULE|'; do
            sed "0,/${mistake%%|*}/s/${mistake%%|*}/$(cut -d'|' -f2 <<<"$mistake")/" "$out/rapid-pick-and-place/$file" >"$out/wrong.mod"
            cmp --silent "$out/rapid-pick-and-place/$file" "$out/wrong.mod" && continue
            if "$python" -m rapidchecker "$out/wrong.mod" >/dev/null 2>&1; then
                echo "the grammar of RAPID accepts $mistake in $file" >&2
                return 1
            fi
            found=$((found + 1))
        done
    done
    (( found >= 10 )) || { echo "only $found mistakes could be made in the RAPID files" >&2; return 1; }
    echo "exported RAPID: no fault in any file by the grammar of others, which finds $found mistakes of $found"
}

# codesys_grammar PYTHON DIRECTORY: the same for CODESYS, by blark. Its whole file takes a minute, so mistakes are looked for in one block.
codesys_grammar() {
    local python=$1 out=$2 file mistake
    built plc-node export --for codesys --setup A --out "$out/codesys"
    file=$out/codesys/skillbench.xml
    "$python" scripts/codesys-grammar.py "$file"
    for mistake in 'END_IF;|' ' := | = = ' ' THEN$|' 'END_VAR|'; do
        "$python" scripts/codesys-grammar.py --only SB_NextUint --replace "$mistake" "$file" 2>/dev/null && {
            echo "the grammar of CODESYS accepts $mistake" >&2
            return 1
        }
    done
    echo "exported PLCopen XML: no fault by the grammar of others, which finds 4 mistakes of 4"
}
