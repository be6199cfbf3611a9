# shellcheck shell=bash
# Studies on engines that others wrote, and their rows read by programs that others wrote.

# The study of CI: 200 jobs, of which some fail.
STUDY='[study]
setup = "A"
types = ["cm"]
reps = 2
seeds = "1..=50"
[[vary]]
key = "motions.approximation_mm"
values = [0.0, 10.0]
[[vary]]
key = "faults"
values = ["", "loss=0.01"]'

# digest_of DIRECTORY: merges the shards in a directory, prints the digest.
digest_of() {
    { built bench study merge "$1" --out "$1-merged" || [ $? -eq 4 ]; } | sed -n 's/^digest //p'
}

# Processes of Slurm that were started here.
SLURM_PIDS=()

# slurm_here DIRECTORY: starts Slurm's controller and one node on this machine, with their files in a directory; slurm_stop ends them.
slurm_here() {
    local cores
    cores=$(nproc)
    export SLURM_CONF=$1/slurm.conf
    mkdir -p "$1/state" "$1/spool" "$1/munge"
    dd if=/dev/urandom of="$1/munge.key" bs=1024 count=1 status=none
    chown -R munge: "$1/munge" "$1/munge.key"
    chmod 400 "$1/munge.key"
    # munged wants a path to its socket that nobody else can write.
    chmod 755 "$1" "$1/munge"
    setpriv --reuid munge --regid munge --clear-groups munged --foreground --key-file "$1/munge.key" --socket "$1/munge/socket" \
        --pid-file "$1/munge/pid" --log-file "$1/munge/log" --seed-file "$1/munge/seed" >"$1/munged.log" 2>&1 &
    SLURM_PIDS=($!)
    cat >"$SLURM_CONF" <<CONF
ClusterName=studies
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmctldPort=16817
SlurmdPort=16818
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$1/munge/socket
StateSaveLocation=$1/state
SlurmdSpoolDir=$1/spool
SlurmctldPidFile=$1/slurmctld.pid
SlurmdPidFile=$1/slurmd.pid
SlurmctldLogFile=$1/slurmctld.log
SlurmdLogFile=$1/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
MpiDefault=none
JobRequeue=1
SchedulerParameters=sched_interval=1,batch_sched_delay=0
MinJobAge=300
NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=$cores State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
CONF
    local tries=0
    until [ -S "$1/munge/socket" ]; do
        sleep 0.1
        tries=$((tries + 1))
        [ "$tries" -lt 100 ] || { cat "$1"/*.log >&2; return 1; }
    done
    # In the foreground of shells in the background, so that their ends are known.
    slurmctld -D -c >"$1/ctld.log" 2>&1 &
    SLURM_PIDS+=($!)
    slurmd -D >"$1/d.log" 2>&1 &
    SLURM_PIDS+=($!)
    until sinfo --noheader 2>/dev/null | grep -q idle; do
        sleep 0.2
        tries=$((tries + 1))
        [ "$tries" -lt 100 ] || { cat "$1"/*.log >&2; return 1; }
    done
}

slurm_stop() {
    local pid
    for pid in "${SLURM_PIDS[@]}"; do
        kill "$pid" 2>/dev/null || true
        wait "$pid" 2>/dev/null || true
    done
}

# until_done DIRECTORY: waits until all shards of a directory are complete.
until_done() {
    local waited=0
    # Code 4: jobs that failed are rows, too.
    until { built bench study status "$1" 2>/dev/null || true; } | grep -q "The study is complete"; do
        sleep 0.5
        waited=$((waited + 1))
        [ "$waited" -lt 240 ] || { cat "$1"/*.log >&2; return 1; }
    done
}

# kill_one DIRECTORY: kills the process of a shard once its rows have begun; prints the shard.
kill_one() {
    local shard pid
    for _ in $(seq 200); do
        for shard in "$1"/shard-*; do
            [ "$(wc -l 2>/dev/null <"$shard/jobs.csv" || echo 0)" -gt 3 ] || continue
            for pid in $(pgrep --full -- "--out $shard --shard"); do
                if kill -KILL "$pid" 2>/dev/null; then
                    echo "${shard##*-}"
                    return
                fi
            done
        done
        sleep 0.02
    done
    echo "no shard was running" >&2
    return 1
}

verb_studies() { #: a study on this machine's cores, Slurm and HyperQueue, a worker killed; its rows in pandas, Polars and DuckDB (as root)
    build
    local out local_digest digest killed began=$SECONDS
    python_tool studies hyperqueue==0.27.0 pandas==3.1.1 polars==2.1.0 duckdb==2.0.1 scipy==1.17.1 \
        kubernetes-validate==1.37.0
    out=$(mktemp -d)
    # shellcheck disable=SC2064 # the directory of now
    trap "slurm_stop; rm -rf '$out'" EXIT
    echo "$STUDY" >"$out/study.toml"
    chmod 755 "$out"
    mkdir "$out/slurm" "$out/on-slurm"
    built bench study submit "$out/study.toml" --engine local --shards 3 --out "$out/local" >/dev/null || [ $? -eq 4 ]
    local_digest=$(digest_of "$out/local")
    "$TOOLS/python" scripts/read-rows.py "$out/local-merged"
    slurm_here "$out/slurm"
    built bench study submit "$out/study.toml" --engine slurm --shards 3 --out "$out/on-slurm"
    killed=$(kill_one "$out/on-slurm")
    # A shard that was killed is handed over again, and goes on.
    sleep 1
    built bench study submit "$out/study.toml" --engine slurm --shards 3 --out "$out/on-slurm" >/dev/null
    until_done "$out/on-slurm"
    digest=$(digest_of "$out/on-slurm")
    [ "$digest" = "$local_digest" ] || { echo "Slurm: $digest, here: $local_digest" >&2; return 1; }
    echo "Slurm, shard $killed killed: $digest"
    (
        killed=
        built bench study submit "$out/study.toml" --engine hq --shards 3 --out "$out/on-hq" --python "$TOOLS/python" >/dev/null 2>&1 &
        kill_one "$out/on-hq" >/dev/null
        wait $! || true
    )
    built bench study submit "$out/study.toml" --engine hq --shards 3 --out "$out/on-hq" --python "$TOOLS/python" >/dev/null || [ $? -eq 4 ]
    digest=$(digest_of "$out/on-hq")
    [ "$digest" = "$local_digest" ] || { echo "HyperQueue: $digest, here: $local_digest" >&2; return 1; }
    echo "HyperQueue, a shard killed: $digest"
    cp "$out/study.toml" "$out/local/study.toml"
    built bench study submit "$out/local/study.toml" --engine kubernetes --shards 3 --out "$out/local" --image skillbench:1 \
        --volume studies --print >"$out/job.yaml"
    "$TOOLS/kubernetes-validate" "$out/job.yaml"
    echo "200 jobs at 3 shards, three times, in $((SECONDS - began)) s"
}

verb_identification() { #: what Table 2 says about Setups A and B: 960 jobs, then the same by emcee, numpy and scipy (minutes; release build)
    local setup out
    python_tool identification emcee==3.1.6 numpy==2.4.6 scipy==1.17.1
    cargo build --release --locked --package bench
    out="${CARGO_TARGET_DIR:-target}/identification"
    for setup in a b; do
        "${CARGO_TARGET_DIR:-target}/release/bench" study run "bench/studies/examples/identification-$setup.toml" --out "$out-$setup" --quiet
        "${CARGO_TARGET_DIR:-target}/release/bench" study report "$out-$setup"
        "$TOOLS/python" scripts/posterior.py "$out-$setup"
    done
}
