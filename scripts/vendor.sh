#!/usr/bin/env bash
# Makes the libraries of race.html in bench/vendor again, from the versions that its package-lock.json pins by digest.
#
# usage: scripts/vendor.sh           write them
#        scripts/vendor.sh --check   fail where the committed ones differ
set -euo pipefail
cd "$(dirname "$0")/.."

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp bench/vendor/{package.json,package-lock.json,three.js} "$work"
npm ci --prefix "$work" --no-audit --no-fund --silent --ignore-scripts
modules=$work/node_modules
out=$work/out
mkdir "$out"

version() { node -p "require('$modules/$1/package.json').version"; }
# banner NAME: the licence in full, as it requires, in a comment that stays in the page.
banner() { printf '/*!\n%s %s\n\n%s\n*/\n' "$1" "$(version "$1")" "$(cat "$modules/$1/LICENSE")"; }

{
    banner three
    "$modules/.bin/esbuild" "$work/three.js" --bundle --minify --format=iife --global-name=THREE --target=es2022 \
        --legal-comments=none --log-level=warning
} >"$out/three.min.js"
{ banner uplot && grep -v '^//# sourceMappingURL' "$modules/uplot/dist/uPlot.iife.min.js"; } >"$out/uplot.min.js"
{ banner uplot && cat "$modules/uplot/dist/uPlot.min.css"; } >"$out/uplot.min.css"
(cd "$out" && sha256sum -- *.min.*) >"$out/SHA256SUMS"

# What would end a script or a style in the middle of the page.
if grep -lF -e '</script' -e '<!--' -e '</style' "$out"/*.js "$out"/*.css; then
    echo "these files cannot be included in a page" >&2
    exit 1
fi
if [ "${1:-}" = --check ]; then
    for file in "$out"/*; do cmp "$file" "bench/vendor/${file##*/}"; done
    echo "bench/vendor is what scripts/vendor.sh makes"
else
    cp "$out"/* bench/vendor/
    (cd bench/vendor && wc -c -- *.min.*)
fi
