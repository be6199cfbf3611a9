#!/usr/bin/env bash
# Checks the documentation: every link has a target, and every shown command works.
#
#   scripts/docs.sh            self-test, links, reference, commands
#   scripts/docs.sh self-test  show that the checks below find a broken link and a failing command
#   scripts/docs.sh links      relative links, #anchors and paths in `code` of every tracked *.md
#   scripts/docs.sh reference  each command, option and key that there is stands on its page
#   scripts/docs.sh commands [FILE...]
#                              run every block tagged ```sh of README.md and docs/, or of these files, and compare the
#                              output that they quote; compare the options of ```console blocks with --help
#
# A block tagged ```text says in the line above where it is from: <!-- printed by: COMMAND -->, <!-- tested in: FILE --> or
# <!-- drawing -->. What a command prints, here and there shortened, is compared line by line, and so is what a test asserts.
#
# The blocks of one file run in order in one new copy of the repository. `cargo run -p PROGRAM -- ARGUMENT...` runs
# PROGRAM as it is built in target/debug. A block that cannot run in CI is tagged ```console or ```text. In a ```console block each
# line after a prompt ($, # or name$) is a command; any other is output, and then the block says where it is from, too.
# shellcheck disable=SC2016 # what stands in single quotes is awk, sed and Markdown
set -euo pipefail
cd "$(dirname "$0")/.."
export LC_ALL=C.UTF-8 # so that a letter is a letter in anchors
export PROGRAMS="${CARGO_TARGET_DIR:-$PWD/target}/debug"

# Longest time of a block, in s.
LONGEST=300

# prose FILE: prints its lines with their numbers, without fenced blocks.
prose() {
    awk '
        match($0, /^ *(```+|~~~+)/) {
            mark = substr($0, RSTART, RLENGTH); gsub(/ /, "", mark)
            if (fence == "") { fence = mark; next }
            if (substr(mark, 1, length(fence)) == fence) { fence = ""; next }
        }
        fence == "" { print NR ":" $0 }
    ' "$1"
}

# links FILE: prints its links as LINE:TARGET, from [text](target), [name]: target and src="target"; code contains no
# links.
links() {
    prose "$1" | sed -E 's/`[^`]*`//g' | awk '
        {
            at = index($0, ":"); line = substr($0, 1, at - 1); rest = substr($0, at + 1)
            if (match(rest, /^ *\[[^]^][^]]*\]: +[^ ]+/)) {
                target = substr(rest, RSTART, RLENGTH); sub(/^ *\[[^]]*\]: +/, "", target); print line ":" target
            }
            while (match(rest, /\]\([^) ]+|src="[^"]+/)) {
                target = substr(rest, RSTART, RLENGTH); rest = substr(rest, RSTART + RLENGTH)
                sub(/^(\]\(|src=")/, "", target); print line ":" target
            }
        }'
}

# anchors FILE: prints the anchors of its headings as GitHub makes them, and those written as HTML.
anchors() {
    local line text slug
    local -A seen=()
    while IFS= read -r line; do
        text=${line#*:}
        [[ $text =~ ^#{1,6}\ +(.*)$ ]] || continue
        text=$(sed -E 's/\[([^]]*)\]\([^)]*\)/\1/g; s/ +#* *$//' <<<"${BASH_REMATCH[1]}")
        slug=${text,,}
        slug=${slug//[^[:alnum:] _-]/}
        slug=${slug// /-}
        if [ -n "${seen[$slug]:-}" ]; then
            echo "$slug-${seen[$slug]}"
        else
            echo "$slug"
        fi
        seen[$slug]=$((${seen[$slug]:-0} + 1))
    done < <(prose "$1")
    grep -oE '(id|name)="[^"]+"' "$1" | sed -E 's/^[^"]*"//; s/"$//' || true
}

# broken_links DIRECTORY FILE...: prints each link of these files without a target; fails if there is one.
broken_links() {
    local directory=$1 file link target path anchor status=0
    for file in "${@:2}"; do
        while IFS= read -r link; do
            target=${link#*:}
            [[ $target =~ ^[a-z][a-z+.-]*: ]] && continue # another scheme: not ours to check
            path=${target%%#*}
            anchor=
            [[ $target == *#* ]] && anchor=${target#*#}
            if [ -z "$path" ]; then
                path=$directory/$file
            elif [[ $path == /* ]]; then
                path=$directory$path
            else
                path=$(dirname "$directory/$file")/$path
            fi
            if [ ! -e "$path" ]; then
                echo "$file:${link%%:*}: there is no $target"
                status=1
            elif [ -n "$anchor" ] && [[ $path == *.md ]] && ! grep -qxF -- "$anchor" <<<"$(anchors "$path")"; then
                echo "$file:${link%%:*}: $path has no heading with the anchor #$anchor"
                status=1
            fi
        done < <(links "$directory/$file")
    done
    return "$status"
}

# split_blocks FILE DIRECTORY: writes each block tagged `sh` to DIRECTORY/LINE.sh, where LINE is its first line, and each
# quoted output to LINE.quote, whose first line says where it is from; and the commands of each block tagged `console`, a line each, to
# LINE.console.
split_blocks() {
    awk -v directory="$2" '
        /^ *```/ && (out != "" || console != "") {
            if (console != "") { close(console); close(quote) } else { close(out) }
            out = console = ""; next
        }
        /^ *```sh *$/ { out = sprintf("%s/%05d.sh", directory, NR + 1); printf "" > out; next }
        /^ *```text *$/ { out = sprintf("%s/%05d.quote", directory, NR + 1); print above > out; next }
        /^ *```console *$/ {
            indent = index($0, "`") - 1; goes_on = quoted = 0
            console = sprintf("%s/%05d.console", directory, NR + 1); quote = sprintf("%s/%05d.quote", directory, NR + 1); next
        }
        console != "" {
            line = substr($0, indent + 1)
            if (goes_on || line ~ /^([a-z]*[$]|#) /) {
                if (!goes_on) sub(/^[^ ]+ +/, "", line)
                goes_on = sub(/ *\\$/, " ", line)
                printf "%s%s", line, goes_on ? "" : "\n" > console
            } else if (NF) {
                if (!quoted++) print above > quote
                print line > quote
            }
            next
        }
        out != "" { print > out }
        NF { above = $0; sub(/^ +/, "", above) }
    ' "$1"
}

# unknown_options COMMANDS: prints each option in these commands that --help of its program does not have; fails if there is one.
unknown_options() {
    local line help word status=0
    local -a words path
    while IFS= read -r line; do
        path=()
        # Without comments, quoted texts, and what stands in for a program.
        read -ra words < <(sed -E "s/ # .*//; s/'[^']*'//g; s/\"[^\"]*\"//g; s/cargo run -p ([a-z-]+) --( |$)/\1 /" <<<"$line")
        for word in "${words[@]}"; do
            if [ ${#path[@]} -eq 0 ]; then
                [[ $word =~ ^(bench|plc-node|robot-node)$ ]] || continue
                path=("$word")
            elif [[ $word =~ ^[|\;\&] ]]; then
                path=()
                continue
            elif [[ $word == -* ]]; then
                grep -qE -- "(^|[ ,])${word%%=*}([ ,=[]|$)" <<<"$help" || { echo "${path[*]} has no option ${word%%=*}"; status=1; }
                continue
            elif [[ $help == *$'\n'"  $word "* ]]; then
                path+=("$word")
            else
                continue
            fi
            help=$("$PROGRAMS/${path[0]}" "${path[@]:1}" --help)
        done
    done <"$1"
    return "$status"
}

# wrong_quote QUOTE DIRECTORY: prints the first line of a quoted output that is not printed, or not in that order; fails if there
# is one.
wrong_quote() {
    local quote=$1 from output
    from=$(head -n 1 "$quote")
    output=$(mktemp)
    case $from in
        '<!-- printed by: '*' -->')
            from=${from#<!-- printed by: } from=${from% -->}
            (cd "$2" && timeout "$LONGEST" bash -uo pipefail -c "$from") >"$output" 2>&1 </dev/null || true ;;
        '<!-- tested in: '*' -->')
            from=${from#<!-- tested in: } from=${from% -->}
            # The name of the file in the example is not that of the test.
            sed -i -E '2,$s/^[a-z-]+\.[a-z]+://' "$quote"
            cp "$2/$from" "$output" ;;
        '<!-- drawing -->') return 0 ;;
        *) echo "say above the block where it is from: <!-- printed by: COMMAND -->, <!-- tested in: FILE --> or <!-- drawing -->"; return 1 ;;
    esac
    awk -v quote="$quote" '
        BEGIN { while ((getline line < quote) > 0) if (number++ && line !~ /^ *$/) wanted[++count] = line; next_one = 1 }
        { sub(/ +$/, "") }
        next_one <= count && index($0, wanted[next_one]) { next_one++ }
        END { if (next_one <= count) { print "not printed: " wanted[next_one]; exit 1 } }
    ' "$output"
}

# cargo: what stands in for cargo in a block. The programs are built already, with all features.
cargo() {
    local program='' command="cargo $*"
    if [ "${1:-}" = run ]; then
        shift
        while [ $# -gt 0 ]; do
            case $1 in
                -p | --package) program=$2; shift 2 ;;
                --features) shift 2 ;;
                --release | --quiet | -q) shift ;;
                --) shift; break ;;
                *) program=; break ;;
            esac
        done
        if [ -n "$program" ] && [ -x "$PROGRAMS/$program" ]; then
            "$PROGRAMS/$program" "$@"
            return
        fi
    fi
    echo "a documented command may be \`cargo run -p PROGRAM -- ARGUMENT...\` with a program in $PROGRAMS, not: $command" >&2
    return 1
}

# failing_blocks FILE DIRECTORY: runs the blocks of the file in the directory, in order; names the one that fails.
failing_blocks() {
    local blocks block line count=0 status=0
    blocks=$(mktemp -d)
    split_blocks "$1" "$blocks"
    for block in "$blocks"/*; do
        [ -e "$block" ] || continue
        line=$(basename "${block%.*}")
        if [[ $block == *.console ]]; then
            if ! unknown_options "$block" >"$blocks/output"; then
                echo "$1:$((10#$line)): $(cat "$blocks/output")"
                status=1
            fi
            continue
        fi
        if [[ $block == *.quote ]]; then
            if ! wrong_quote "$block" "$2" >"$blocks/output"; then
                echo "$1:$((10#$line)): the quoted output is not what the program prints: $(cat "$blocks/output")"
                status=1
            fi
            continue
        fi
        if ! (cd "$2" && timeout "$LONGEST" bash -euo pipefail "$block") >"$blocks/output" 2>&1 </dev/null; then
            echo "$1:$((10#$line)): a command of this block fails:"
            sed 's/^/    /' "$block"
            echo "  its output:"
            tail -n 40 "$blocks/output" | sed 's/^/    /'
            status=1
            break # those after it may need what it should have done
        fi
        count=$((count + 1))
    done
    rm -rf "$blocks"
    [ "$status" -ne 0 ] || echo "$1: $count blocks run"
    return "$status"
}

# paths FILE: prints its paths as LINE:PATH: `code` that begins with a folder of this repository. A path with a word
# in capitals, such as SETUP.json, is a placeholder and left out.
paths() {
    prose "$1" | awk -v folders="$2" '
        {
            at = index($0, ":"); line = substr($0, 1, at - 1); rest = substr($0, at + 1)
            while (match(rest, /`[^`]+`/)) {
                path = substr(rest, RSTART + 1, RLENGTH - 2); rest = substr(rest, RSTART + RLENGTH)
                sub(/ .*/, "", path); split(path, parts, "/")
                if (index(path, "/") && index(folders, " " parts[1] " ") && path !~ /[A-Z][A-Z]/) print line ":" path
            }
        }'
}

# gone_paths DIRECTORY FILE...: prints each path in these files that does not exist; fails if there is one.
gone_paths() {
    local directory=$1 folders file path status=0
    folders=$(cd "$directory" && find . -maxdepth 1 -type d -name '[a-z]*' ! -name target ! -name runs -printf ' %P ')
    for file in "${@:2}"; do
        while IFS= read -r path; do
            if [ ! -e "$directory/${path#*:}" ]; then
                echo "$file:${path%%:*}: there is no ${path#*:}"
                status=1
            fi
        done < <(paths "$directory/$file" "$folders")
    done
    return "$status"
}

# check_links: checks all tracked Markdown files.
check_links() {
    local files
    mapfile -t files < <(git ls-files --cached --others --exclude-standard '*.md')
    broken_links . "${files[@]}"
    gone_paths . "${files[@]}"
    echo "links: ${#files[@]} files, none broken"
}

# check_commands [FILE...]: runs each file's blocks in a new copy of the repository, so that nothing is left in this
# one.
check_commands() {
    local files=("$@") file copy status=0
    [ ${#files[@]} -gt 0 ] || mapfile -t files < <(git ls-files --cached --others --exclude-standard README.md 'docs/*.md')
    export -f cargo
    for file in "${files[@]}"; do
        copy=$(mktemp -d)
        git ls-files -z | tar --null --files-from - --create --file - | tar --extract --file - --directory "$copy"
        failing_blocks "$file" "$copy" || status=1
        rm -rf "$copy"
    done
    return "$status"
}

# undocumented PAGE: prints each line of standard input that PAGE does not contain as `code`; fails if there is one.
undocumented() {
    local page=$1 name status=0
    while IFS= read -r name; do
        if ! grep -qE -- "\`([^\`]*[^\`a-z_-])?$name([^\`a-z_-][^\`]*)?\`" "$page"; then
            echo "$page does not explain $name"
            status=1
        fi
    done
    return "$status"
}

# help_names: prints the commands and options of every program, from its --help.
help_names() {
    local program command
    for program in bench plc-node robot-node; do
        "$PROGRAMS/$program" --help | grep -oE '^ +(-[a-zA-Z], )?--[a-z-]+' | grep -oE -- '--[a-z-]+'
        "$PROGRAMS/$program" --help | awk '/^[A-Z].*:$/ { commands = /^(Commands|.* commands).*:$/ } commands && /^  [a-z]/ { print $1 }' |
            while IFS= read -r command; do
                [ "$command" != help ] || continue
                echo "$program $command"
                "$PROGRAMS/$program" "$command" --help | grep -oE '^ +(-[a-zA-Z], )?--[a-z-]+' | grep -oE -- '--[a-z-]+'
            done
    done | sort -u
}

# file_keys FILE...: prints the keys and sections of these TOML files, without names chosen by their author; the sections of a
# station are those of a setup.
file_keys() {
    sed -E 's/#.*//; s/"[^"]*"//g' "$@" | awk '
        /^\[/ { section = $0; gsub(/[][ ]/, "", section); sub(/^station[.]/, "", section); print section }
        /=/ {
            free = section ~ /^(arm[.])?(tools|bases|frames|grids|actions)$/
            while (match($0, /[A-Za-z_][A-Za-z0-9_-]* *=/)) {
                key = substr($0, RSTART, RLENGTH - 1); $0 = substr($0, RSTART + RLENGTH); gsub(/ /, "", key)
                if (!free) print key
                free = 0
            }
        }' | sort -u
}

# check_reference: checks that the commands, options and keys of the programs and the shipped files are explained.
check_reference() {
    help_names | undocumented docs/command-line.md
    file_keys cell/setups/*.toml | undocumented docs/setups.md
    file_keys cell/applications/*.toml | undocumented docs/applications.md
    echo "reference: every command, option and key is explained"
}

# expect NAME EXPECTED FOUND: makes one check of the self-test.
expect() {
    if [ "$2" != "$3" ]; then
        printf 'self-test: %s\n  expected: %s\n  found:    %s\n' "$1" "$2" "$3" >&2
        return 1
    fi
}

# self_test: tests that the checks find what is broken, and nothing else.
self_test() {
    local here found
    here=$(mktemp -d)
    # shellcheck disable=SC2064 # the directory of now
    trap "rm -rf '$here'" EXIT
    mkdir "$here/docs"
    printf '%s\n' '# Réglage: a `key_name` (µs)' '## Twice' '## Twice' '```text' '# no heading' '```' >"$here/docs/there.md"
    printf '%s\n' '[1](docs/there.md#réglage-a-key_name-µs) [2](docs/there.md#twice-1) [3](#here)' '# Here' \
        '`[code](is/no/link.md)`' '```sh' '[nor](is/a/block.md)' '```' '[4](https://example.org/x) [5](docs/)' >"$here/good.md"
    found=$(broken_links "$here" good.md docs/there.md) || true
    expect "good links pass" "" "$found"
    printf '%s\n' '[1](docs/gone.md) [2](docs/there.md#gone)' '[3](docs/there.md#no-heading)' '' '[name]: gone.png' >"$here/bad.md"
    if found=$(broken_links "$here" bad.md); then
        echo "self-test: broken links pass" >&2
        return 1
    fi
    expect "each broken link is named by its line" "bad.md:1 bad.md:1 bad.md:2 bad.md:4" \
        "$(sed -E 's/^([^:]*:[0-9]+):.*/\1/' <<<"$found" | paste -sd ' ')"

    printf '%s\n' '`docs/there.md` `docs/gone.md --with` `docs/NAME.md` `other/x.md`' '```text' '`docs/block`' '```' >"$here/paths.md"
    found=$(gone_paths "$here" paths.md) || true
    expect "a path that is gone is named" "paths.md:1: there is no docs/gone.md" "$found"
    printf '%s\n' '`--there FILE`, `[part.of]` `key`' >"$here/page.md"
    found=$(printf '%s\n' --there part.of key --the ke --gone | undocumented "$here/page.md") || true
    expect "names that a page lacks are named" "--the ke --gone" "$(awk '{ print $NF }' <<<"$found" | paste -sd ' ')"
    printf '%s\n' '[part.of] # c = 1' 'a_b = { value = 1, note = "x = 1" }' '[[frames]]' 'mine = { on = 1 }' >"$here/file.toml"
    expect "keys of a file" "a_b frames note on part.of value" "$(file_keys "$here/file.toml" | paste -sd ' ')"

    export -f cargo
    printf '%s\n' '```sh' 'echo one >file' '```' '```console' '$ false' '```' '```sh' 'test "$(cat file)" = one' '```' >"$here/runs.md"
    found=$(failing_blocks "$here/runs.md" "$here") || true
    expect "good blocks run in one directory, and no other block runs" "$here/runs.md: 2 blocks run" "$found"
    local -A bad=(
        [false]=$'false\ntrue'
        [pipe]='false | cat'
        [unset]='echo "$NOT_SET"'
        [cargo]='cargo build --release'
        [program]='cargo run -p no-such-program -- --help'
    )
    printf '%s\n' '<!-- printed by: seq 5; echo end >&2 -->' '```text' '2' '' '4' 'end' '```' '<!-- drawing -->' '```text' 'o' '```' \
        >"$here/quotes.md"
    found=$(failing_blocks "$here/quotes.md" "$here") || true
    expect "a quoted output that is printed passes" "$here/quotes.md: 0 blocks run" "$found"
    printf '%s\n' '<!-- printed by: seq 5 -->' '```text' '4' '2' '```' '' '```text' 'o' '```' >"$here/stale.md"
    found=$(failing_blocks "$here/stale.md" "$here") || true
    expect "a stale quote is named by its line, and so is one from nowhere" "$here/stale.md:3 $here/stale.md:8" \
        "$(sed -E 's/^([^:]*:[0-9]+):.*/\1/' <<<"$found" | paste -sd ' ')"
    # shellcheck disable=SC1003 # a line that goes on
    printf '%s\n' '1. item' '' '   <!-- printed by: echo up; seq 3 -->' '   ```console' '   # plc-node io --device "a b.eds" \\' '       --at "x"' '   up' '   3' \
        '   ```' '```console' 'plc$  plc-node run --setup A' '$ bench study run a.toml --out b | head -n 3 # --no' '```' >"$here/console.md"
    found=$(failing_blocks "$here/console.md" "$here") || true
    expect "output in a console block is compared, and its commands have options that exist" "$here/console.md: 0 blocks run" "$found"
    printf '%s\n' '```console' '$ echo' 'from nowhere' '```' '' '<!-- printed by: echo down -->' '```console' '$ bench --stup A' 'up' '```' \
        >"$here/console.md"
    found=$(failing_blocks "$here/console.md" "$here") || true
    expect "stale output, output from nowhere and an option that is gone are named by the line of their block" \
        "$here/console.md:2 $here/console.md:8 $here/console.md:8" "$(sed -E 's/^([^:]*:[0-9]+):.*/\1/' <<<"$found" | paste -sd ' ')"
    local name
    for name in "${!bad[@]}"; do
        printf '%s\n' '```sh' 'true' '```' 'text' '```sh' "${bad[$name]}" '```' >"$here/$name.md"
        if found=$(failing_blocks "$here/$name.md" "$here"); then
            echo "self-test: a failing command passes: ${bad[$name]}" >&2
            return 1
        fi
        expect "the failing block is named by its line" "$here/$name.md:6: a command of this block fails:" "$(head -n 1 <<<"$found")"
    done
    echo "self-test: broken links and failing commands are found"
}

case ${1:-all} in
    self-test) self_test ;;
    links) check_links ;;
    reference) check_reference ;;
    commands) check_commands "${@:2}" ;;
    all)
        # One by one: in a list with &&, a failure within a function would not end the function.
        self_test
        check_links
        check_reference
        check_commands
        ;;
    *) sed -n '2,/^set/p' "$0" | sed -n 's/^# \{0,1\}//p' >&2; exit 2 ;;
esac
