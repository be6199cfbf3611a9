# shellcheck shell=bash
# The containers of docs/permissions.md, for real.

# demo_compose ARGUMENT...: runs compose, either the engine's plugin or the separate program. The latter lets the
# docker client build images; Debian's client does so by BuildKit, without a plugin.
demo_compose() {
    if docker compose version >/dev/null 2>&1; then
        docker compose "$@"
    else
        PATH="/usr/bin:$PATH" DOCKER_BUILDKIT=1 COMPOSE_DOCKER_CLI_BUILD=1 docker-compose "$@"
    fi
}

# demo_engine: starts an engine of our own, so that nothing of ours stays in another one. It has a local image in
# place of the one that the Dockerfile would pull.
demo_engine() {
    DEMO_ENGINE=$(mktemp -d)
    export DOCKER_HOST="unix://$DEMO_ENGINE/socket"
    dockerd --data-root "$DEMO_ENGINE/data" --exec-root "$DEMO_ENGINE/exec" --pidfile "$DEMO_ENGINE/pid" \
        --host "$DOCKER_HOST" >"$DEMO_ENGINE/log" 2>&1 &
    local engine=$! tries=0
    until docker info >/dev/null 2>&1; do
        if ! kill -0 "$engine" 2>/dev/null || [ $((tries += 1)) -gt 150 ]; then
            echo "dockerd does not run here; it said:" >&2
            tail "$DEMO_ENGINE/log" >&2
            return 1
        fi
        sleep 0.2
    done
    scripts/demo/base-image.sh "$(sed -n 's/^FROM \(.*\) AS build$/\1/p' Dockerfile)"
}

# demo_end: removes everything that verb_demo started.
demo_end() {
    demo_compose down --volumes --rmi all --remove-orphans >/dev/null 2>&1 || true
    if [ -n "${DEMO_ENGINE:-}" ]; then
        local engine
        engine=$(cat "$DEMO_ENGINE/pid" 2>/dev/null || true)
        if [ -n "$engine" ] && kill "$engine" 2>/dev/null; then tail --pid "$engine" -f /dev/null; fi
        ip link delete docker0 2>/dev/null || true
        rm -rf "$DEMO_ENGINE"
    fi
    rm -rf "${RUNS:-}"
}

# demo_up FILE: runs the containers until the bench ends, with its exit code; also writes their output to the file.
demo_up() {
    demo_compose up --no-color --build --abort-on-container-exit --exit-code-from bench | tee "$1"
}

# demo_pair: runs a PLC with two robots, and expects a line of both in each repetition.
demo_pair() {
    local output="$RUNS/E.txt" run
    (
        unset SETUP
        demo_compose --env-file scripts/demo/pair.env up --no-color \
            --abort-on-container-exit --exit-code-from bench
    ) | tee "$output"
    run=$(ls -d "$RUNS"/*-E-real)
    [ "$(grep -c ',left,' "$run/samples.csv")" -eq 3 ]
    [ "$(grep -c ',right,' "$run/samples.csv")" -eq 3 ]
    demo_compose --env-file scripts/demo/pair.env down
}

# demo_wrong_robot: starts a robot of another name at the robot's address, and expects that the PLC refuses it.
demo_wrong_robot() {
    local output
    mkdir -p "$RUNS/station"
    echo '{ "name": "old-robot" }' >"$RUNS/station/old-robot.json"
    output=$(demo_compose -f docker-compose.yml -f scripts/demo/wrong-robot.yml up --no-color \
        --abort-on-container-exit --exit-code-from bench 2>&1) && { echo "$output"; return 1; }
    demo_compose -f docker-compose.yml -f scripts/demo/wrong-robot.yml down
    grep -m 1 'another station has this IP address' <<<"$output" || { echo "$output"; return 1; }
}

verb_demo() { #: the containers of docs/permissions.md for real, Setups A, B, C and E, REPS=1 of each type (as root)
    export REPS="${REPS:-1}" PROFILE="${PROFILE:-dev}" COMPOSE_PROJECT_NAME=skillbench-ci IMAGES=skillbench-ci
    export SETUP RUNS BENCH_USER=65534:65534
    trap demo_end EXIT
    docker info >/dev/null 2>&1 || demo_engine
    RUNS=$(mktemp -d)
    chown "$BENCH_USER" "$RUNS"
    local output type
    for SETUP in A B C; do
        output="$RUNS/$SETUP.txt"
        demo_up "$output"
        for type in RC SM CM; do grep -qE "\| +$type +[0-9]+\.[0-9]" "$output"; done
        ls "$RUNS"/*"-$SETUP-real/results.json"
        # What a plain build lacks it refuses in words.
        output=$(demo_compose run --rm --no-deps bench --mode virtual --mcap 2>&1) && return 1
        grep -q -- '--features mcap' <<<"$output"
        demo_compose down
    done
    demo_pair
    SETUP=A
    demo_wrong_robot
    docker images --format '{{.Repository}} {{.Size}}' | grep "^$IMAGES/"
}
