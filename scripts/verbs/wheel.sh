# shellcheck shell=bash
# The wheel skillbench-fieldbus.

verb_wheel() { #: build the Python wheel with this bench, install it as an ordinary user, and run its tests
    build
    local out as_user
    python_tool wheel setuptools==80.9.0 wheel==0.45.1
    out=$(mktemp -d)
    # shellcheck disable=SC2064 # the directory of now
    trap "rm -rf '$out'" EXIT
    scripts/wheel.sh "${CARGO_TARGET_DIR:-target}/debug/bench" "$out/wheels" "$TOOLS/python"
    as_user=()
    if [ "$(id -u)" = 0 ]; then
        as_user=(scripts/as-user.sh)
        chown -R 65534:65534 "$out"
        chmod 755 "$out"
    fi
    # An empty environment: what it needs comes from the package index, the wheel from its path.
    "${as_user[@]}" env HOME="$out" python3 -m venv "$out/environment"
    "${as_user[@]}" env HOME="$out" "$out/environment/bin/pip" install --quiet --no-cache-dir pytest==8.4.2 jsonschema==4.25.1 "$out"/wheels/*.whl
    "${as_user[@]}" env HOME="$out" "$out/environment/bin/python" -m pytest --quiet -p no:cacheprovider python/tests
}
